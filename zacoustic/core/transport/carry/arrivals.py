"""The subscriber's side of carried topics: each count in order, each sample once.

A sample that can be delivered at once is delivered before its position is journalled: until the hop
by which it came is over, its transport has the sample, and a restart brings it again, flagged so. A
sample that must wait is journalled here.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.carry import Bundle, Envelope
from zacoustic.errors import UnknownStreamError

_COUNT: Final = "carried"
_MOST_LINEAGES: Final = 64
"""How many counts of one key are remembered: each start of its publisher begins one."""


class _Position(msgspec.Struct, frozen=True, array_like=True):
    """A count in the journal."""

    expected: int
    order: int


class _Window:
    """A count of one key."""

    def __init__(self, order: int, expected: int) -> None:
        self.order = order
        self.expected = expected
        """The next number to deliver."""
        self.held: dict[int, SampleReceived | None] = {}
        """Samples that came too early, by number; None: one that cannot be decoded."""
        self.waits_until: int | None = None
        """When the gap before them is given up, ns; None: there is none."""


class Arrivals:
    """The counts of which this node gets samples.

    Args:
        table: The streams.
        journal: Holds the positions.
        hand_on: Takes each sample in order, and the instant.
        is_doubtful: Returns whether this node may have forgotten what it has delivered.
        drop: Counts a sample that cannot be decoded, under one word.
    """

    def __init__(
        self,
        table: StreamTable,
        journal: JournalPort,
        hand_on: Callable[[SampleReceived, int], None],
        is_doubtful: Callable[[], bool],
        drop: Callable[[str], None],
    ) -> None:
        self._table = table
        self._journal = journal
        self._hand_on = hand_on
        self._is_doubtful = is_doubtful
        self._drop = drop
        self._windows: dict[Bundle, _Window] = {}
        self._order = 0

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the counts from before the restart, with what waits in them."""
        for key in sorted(stored, key=len):  # counts before their samples
            kind, _, rest = key.partition("/")
            if kind != _COUNT:
                continue
            bundle, number = _read(rest)
            if self._table.get(bundle.stream_id) is None:
                self._journal.write(key, None)
            elif number is None:
                position = msgspec.msgpack.decode(stored[key], type=_Position)
                self._windows[bundle] = _Window(position.order, position.expected)
                self._order = max(self._order, position.order)
            elif bundle in self._windows:
                envelope = msgspec.msgpack.decode(stored[key], type=Envelope)
                # The node may have died right after the delivery.
                sample = self._decoded(envelope, 0, LinkMetrics(), again=True)
                self._windows[bundle].held[number] = sample

    def take(self, envelope: Envelope, hop: SampleReceived, now: int) -> tuple[int, bool]:
        """Take a sample; return the next number that its count awaits, and whether it is new.

        Args:
            envelope: The sample.
            hop: How it came.
            now: The instant.
        """
        bundle, number = envelope.bundle, envelope.number
        window = self._windows.get(bundle)
        if window is None:
            window = self._begin(bundle, envelope.floor or 0)
        if number < window.expected or number in window.held:
            return window.expected, False
        before = window.expected
        again = hop.again or self._is_doubtful()
        window.held[number] = self._decoded(envelope, hop.received_at, hop.metrics, again=again)
        depth = self._table.by_id(bundle.stream_id).qos.depth
        self._advance(bundle, window, max(envelope.floor or 0, number - depth + 1), now)
        if number >= window.expected:
            self._journal.write(_name(bundle, number), msgspec.msgpack.encode(envelope))
        if window.expected != before:
            window.waits_until = None
            self._write(bundle, window)
        return window.expected, True

    def waits_until(self, bundle: Bundle, longest_ns: int, now: int) -> int | None:
        """Return when the gap of a count is given up, ns; None: it has none.

        A gap may never fill: what was in it went down with a custodian, or was delivered before an
        old copy of the journal was restored.

        Args:
            bundle: The count.
            longest_ns: How long to wait, ns.
            now: The instant.
        """
        window = self._windows[bundle]
        if not window.held:
            window.waits_until = None
        elif window.waits_until is None:
            window.waits_until = now + longest_ns
        return window.waits_until

    def give_up(self, bundle: Bundle, now: int) -> int:
        """Deliver what waits behind the gap of a count; return the next number that it awaits."""
        window = self._windows[bundle]
        window.waits_until = None
        self._advance(bundle, window, min(window.held), now)
        self._write(bundle, window)
        return window.expected

    def __iter__(self) -> Iterator[Bundle]:
        return iter(list(self._windows))

    def forget(self, origin: int) -> None:
        """Forget the counts of a node."""
        for bundle in [each for each in self._windows if each.origin == origin]:
            self._end(bundle)

    # Below the methods above

    def _begin(self, bundle: Bundle, expected: int) -> _Window:
        key = msgspec.structs.replace(bundle, lineage=0)
        known = [each for each in self._windows if msgspec.structs.replace(each, lineage=0) == key]
        if len(known) >= _MOST_LINEAGES:
            self._end(min(known, key=lambda each: self._windows[each].order))
        self._order += 1
        window = self._windows[bundle] = _Window(self._order, expected)
        self._write(bundle, window)
        return window

    def _advance(self, bundle: Bundle, window: _Window, floor: int, now: int) -> None:
        """Deliver what is held below a floor, and what follows without a gap."""
        for number in sorted(window.held):
            if number > max(window.expected, floor):
                break
            sample = window.held.pop(number)
            window.expected = number + 1
            self._journal.write(_name(bundle, number), None)
            if sample is not None:
                self._hand_on(sample, now)
        window.expected = max(window.expected, floor)

    def _decoded(
        self, envelope: Envelope, received_at: int, metrics: LinkMetrics, *, again: bool
    ) -> SampleReceived | None:
        bundle = envelope.bundle
        stream: Stream = self._table.by_id(bundle.stream_id)
        try:
            stream.keys.key(bundle.origin, bundle.instance)
            value = None if envelope.deleted else stream.codec.decode(envelope.payload)
        except (PayloadError, UnknownStreamError):
            self._drop("payload")
            return None
        return SampleReceived(
            stream_id=bundle.stream_id,
            source=bundle.origin,
            instance=bundle.instance,
            value=value,
            deleted=envelope.deleted,
            encoding=envelope.encoding or stream.encoding,
            received_at=received_at,
            metrics=metrics,
            again=again,
        )

    def _write(self, bundle: Bundle, window: _Window) -> None:
        position = _Position(window.expected, window.order)
        self._journal.write(_name(bundle), msgspec.msgpack.encode(position))

    def _end(self, bundle: Bundle) -> None:
        window = self._windows.pop(bundle)
        for number in window.held:
            self._journal.write(_name(bundle, number), None)
        self._journal.write(_name(bundle), None)


def _name(bundle: Bundle, number: int | None = None) -> str:
    parts = (
        bundle.origin, bundle.destination, bundle.stream_id, bytes(bundle.instance).hex(),
        bundle.lineage,
    )  # fmt: skip
    name = "/".join((_COUNT, *map(str, parts)))
    return name if number is None else f"{name}/{number}"


def _read(name: str) -> tuple[Bundle, int | None]:
    origin, destination, stream_id, instance, lineage, *number = name.split("/")
    bundle = Bundle(
        int(origin), int(destination), int(stream_id), tuple(bytes.fromhex(instance)), int(lineage)
    )
    return bundle, int(number[0]) if number else None
