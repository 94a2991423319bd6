"""Overrides of topics by remote commands; they survive a restart, and change no digest."""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.qos import UNTUNED, Qos, Tuning
from zacoustic.core.streams.commands import Order, OrderKind
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import LocalError

_JOURNAL: Final = "tune"


class Tunings:
    """The topics of one node that were tuned.

    Args:
        address: Address of the node.
        table: Its streams.
        tune: Lays an override over the QoS of what waits.
        stored: What the journal has kept.
        journal: Keeps the rest.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        tune: Callable[[Stream, Tuning], None],
        stored: Mapping[str, bytes],
        journal: JournalPort,
    ) -> None:
        self._address = address
        self._table = table
        self._tune = tune
        self._journal = journal
        self._tunings: dict[int, Tuning] = {}
        for name, value in stored.items():
            head, _, stream_id = name.partition("/")
            if head == _JOURNAL:
                self._recover(int(stream_id), value)

    def of(self, stream_id: int) -> Tuning:
        """Return the override of a stream."""
        return self._tunings.get(stream_id, UNTUNED)

    def effective(self, stream: Stream) -> tuple[bool, Qos]:
        """Return whether the samples of a topic go, and its QoS with the override."""
        tuning = self.of(stream.stream_id)
        return tuning.on, tuning.over(stream.qos)

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

    def change(self, order: Order, then: Callable[[int], None]) -> None:
        """Execute a TUNE or RESET; `then` is called when it is written down.

        Raises:
            LocalError: As `check`.
        """
        assert order.stream_id is not None
        stream = self.check(order.stream_id)
        tuning = UNTUNED
        if order.kind is OrderKind.TUNE:
            wanted = {
                "on": order.on,
                "min_interval_s": order.min_interval_s,
                "priority": order.priority,
            }
            changes = {name: value for name, value in wanted.items() if value is not None}
            tuning = msgspec.structs.replace(self.of(stream.stream_id), **changes)
        self._apply(stream, tuning)
        name = f"{_JOURNAL}/{stream.stream_id}"
        value = None if tuning == UNTUNED else msgspec.msgpack.encode(tuning)
        self._journal.write(name, value, then)

    # Below the methods above

    def _recover(self, stream_id: int, value: bytes) -> None:
        try:
            stream = self.check(stream_id)
            tuning = msgspec.msgpack.decode(value, type=Tuning)
        except (LocalError, msgspec.MsgspecError):
            # The table is new now.
            self._journal.write(f"{_JOURNAL}/{stream_id}", None)
            return
        self._apply(stream, tuning)

    def _apply(self, stream: Stream, tuning: Tuning) -> None:
        self._tunings[stream.stream_id] = tuning
        self._tune(stream, tuning)
