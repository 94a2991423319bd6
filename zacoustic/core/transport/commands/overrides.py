"""Overrides of topics by remote commands; they survive a restart and change no digest."""

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
    """The overridden topics of one node.

    Args:
        address: Address of the node.
        table: Its streams.
        override: Applies an override to the QoS of waiting samples.
        stored: The content of the journal.
        journal: Holds the overrides.
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
        self._kept: dict[int, Override] = {}
        """The overrides that the journal has."""
        for name, value in stored.items():
            head, _, stream_id = name.partition("/")
            if head == _JOURNAL:
                self._recover(int(stream_id), value)

    def of(self, stream_id: int) -> Override:
        """Return the override of a stream."""
        return self._overrides.get(stream_id, NO_OVERRIDE)

    def effective(self, stream: Stream) -> tuple[bool, Qos]:
        """Return whether a topic's samples are sent, and its QoS with the override."""
        override = self.of(stream.stream_id)
        return override.on, override.over(stream.qos)

    def check(self, stream_id: int) -> Stream:
        """Return a topic that can be overridden here.

        Raises:
            LocalError: This node does not publish it; the text is short, since it may cross the
                channel.
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
        """Execute OVERRIDE or RESET; call `then` once it is journalled.

        Raises:
            LocalError: As `check`.
        """
        stream, override = self._commanded(command)
        self._apply(stream, override)
        self._kept[stream.stream_id] = override
        name = f"{_JOURNAL}/{stream.stream_id}"
        value = None if override == NO_OVERRIDE else msgspec.msgpack.encode(override)
        self._journal.write(name, value, then)

    def change_for_now(self, command: RemoteCommand) -> None:
        """Execute OVERRIDE or RESET until `restore`.

        Raises:
            LocalError: As `check`.
        """
        self._apply(*self._commanded(command))

    def restore(self, stream_id: int) -> None:
        """Set a topic to the override in the journal."""
        self._apply(self._table.by_id(stream_id), self._kept.get(stream_id, NO_OVERRIDE))

    # Below the methods above

    def _commanded(self, command: RemoteCommand) -> tuple[Stream, Override]:
        assert command.stream_id is not None
        stream = self.check(command.stream_id)
        if command.kind is not CommandKind.OVERRIDE:
            return stream, NO_OVERRIDE
        wanted = {
            "on": command.on,
            "min_interval_s": command.min_interval_s,
            "priority": command.priority,
        }
        changes = {name: value for name, value in wanted.items() if value is not None}
        kept = self._kept.get(stream.stream_id, NO_OVERRIDE)
        return stream, msgspec.structs.replace(kept, **changes)

    def _recover(self, stream_id: int, value: bytes) -> None:
        try:
            stream = self.check(stream_id)
            override = msgspec.msgpack.decode(value, type=Override)
        except (LocalError, msgspec.MsgspecError):
            # The table has changed.
            self._journal.write(f"{_JOURNAL}/{stream_id}", None)
            return
        self._kept[stream_id] = override
        self._apply(stream, override)

    def _apply(self, stream: Stream, override: Override) -> None:
        self._overrides[stream.stream_id] = override
        self._override(stream, override)
