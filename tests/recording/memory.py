"""Recordings in memory, for tests that make hundreds of them."""

from typing import Any

import pytest

from zacoustic.core.clock import NS_PER_S
from zacoustic.run.recording.channels import Channel
from zacoustic.run.recording.reading import ReadMessage
from zacoustic.run.recording.recorder import EngineRecorder
from zacoustic.testing.virtual import VirtualNetwork

BEGAN_NS = 1_767_225_600 * NS_PER_S


class MemorySink:
    """Keeps what is recorded."""

    def __init__(self) -> None:
        self.messages: list[ReadMessage] = []
        self.channels: dict[str, Channel] = {}
        self.is_full = False

    def put(self, channel: Channel, utc_ns: int, data: bytes) -> bool:
        """Take a message, unless it is full."""
        if self.is_full:
            return False
        known = self.channels.setdefault(channel.topic, channel)
        assert known == channel, "two channels of one topic"
        self.messages.append(
            ReadMessage(channel.topic, utc_ns, channel.encoding, channel.metadata, data)
        )
        return True

    def of(self, ending: str) -> list[ReadMessage]:
        """Return the messages of the topics that end so."""
        return [message for message in self.messages if message.topic.endswith(ending)]


def recorded(sink: MemorySink | None = None) -> tuple[EngineRecorder, MemorySink]:
    """Return a recorder into memory."""
    sink = sink or MemorySink()
    return EngineRecorder(sink, lambda address: BEGAN_NS), sink


def record_networks(monkeypatch: pytest.MonkeyPatch) -> tuple[EngineRecorder, MemorySink]:
    """Have every virtual network recorded that somebody makes without saying how."""
    recorder, sink = recorded()
    defaults: dict[str, Any] = VirtualNetwork.__init__.__kwdefaults__  # type: ignore[assignment]
    monkeypatch.setitem(defaults, "build", recorder.make)
    return recorder, sink
