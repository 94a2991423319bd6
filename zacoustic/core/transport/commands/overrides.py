"""Overrides of topics by remote commands; they survive a restart, and change no digest."""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.qos import NO_OVERRIDE, Override, Qos
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import LocalError

_JOURNAL: Final = "tune"


class Overrides:
    """The topics of one node that were tuned.

    Args:
        address: Address of the node.
        table: Its streams.
        override: Lays an override over the QoS of what waits.
        stored: What the journal has kept.
        journal: Keeps the rest.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        override: Callable[[Stream, Override], None],
        stored: Mapping[str, bytes],
        journal: JournalPort,
    ) -> None:
        self._address = address
        self._table = table
        self._override = override
        self._journal = journal
        self._overrides: dict[int, Override] = {}
        for name, value in stored.items():
            head, _, stream_id = name.partition("/")
            if head == _JOURNAL:
                self._recover(int(stream_id), value)

    def of(self, stream_id: int) -> Override:
        """Return the override of a stream."""
        return self._overrides.get(stream_id, NO_OVERRIDE)

    def effective(self, stream: Stream) -> tuple[bool, Qos]:
        """Return whether the samples of a topic go, and its QoS with the override."""
        override = self.of(stream.stream_id)
        return override.on, override.over(stream.qos)

    def check(self, stream_id: int) -> Stream:
        """Return a topic that can be tuned here.

        Raises:
            LocalError: It is none of this node's; in few words, since they may cross the channel.
        """
        stream = self._table.get(stream_id)
        if stream is None:
            raise LocalError(f"node {self._address} has no stream {stream_id}")
        if not isinstance(stream.spec, TopicSpec):
            raise LocalError(f"stream {stream_id} is no topic")
        if not stream.may_publish(self._address):
            raise LocalError(f"node {self._address} does not publish stream {stream_id}")
        return stream

    def change(self, command: RemoteCommand, then: Callable[[int], None]) -> None:
        """Execute a TUNE or RESET; `then` is called when it is written down.

        Raises:
            LocalError: As `check`.
        """
        assert command.stream_id is not None
        stream = self.check(command.stream_id)
        override = NO_OVERRIDE
        if command.kind is CommandKind.OVERRIDE:
            wanted = {
                "on": command.on,
                "min_interval_s": command.min_interval_s,
                "priority": command.priority,
            }
            changes = {name: value for name, value in wanted.items() if value is not None}
            override = msgspec.structs.replace(self.of(stream.stream_id), **changes)
        self._apply(stream, override)
        name = f"{_JOURNAL}/{stream.stream_id}"
        value = None if override == NO_OVERRIDE else msgspec.msgpack.encode(override)
        self._journal.write(name, value, then)

    # Below the methods above

    def _recover(self, stream_id: int, value: bytes) -> None:
        try:
            stream = self.check(stream_id)
            override = msgspec.msgpack.decode(value, type=Override)
        except (LocalError, msgspec.MsgspecError):
            # The table is new now.
            self._journal.write(f"{_JOURNAL}/{stream_id}", None)
            return
        self._apply(stream, override)

    def _apply(self, stream: Stream, override: Override) -> None:
        self._overrides[stream.stream_id] = override
        self._override(stream, override)
