"""The samples that a node keeps for the next hop, in its journal."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.journal import BOOT_KEY, JournalPort
from zacoustic.core.wire.carry import Bundle, Envelope

_SAMPLE: Final = "carry"


class Offered:
    """Something that waits for the next hop."""

    __slots__ = ("offers", "refused")

    def __init__(self) -> None:
        self.offers: dict[int, int] = {}
        """Address of each node that it is offered to → delivery id of that hop."""
        self.refused: set[int] = set()
        """Nodes that do not take it."""


class Held(Offered):
    """A sample in custody of this node.

    Args:
        number: Its place in the journal.
        envelope: The sample.
        ends_at: Instant after which it is worthless, ns.
        delivery_id: What `Engine.publish` returned; None: another node has published it.
    """

    __slots__ = ("custodian", "delivery_id", "ends_at", "envelope", "is_stored", "number")

    def __init__(
        self, number: int, envelope: Envelope, ends_at: int, delivery_id: int | None = None
    ) -> None:
        super().__init__()
        self.number = number
        self.envelope = envelope
        self.ends_at = ends_at
        self.delivery_id = delivery_id
        self.is_stored = False
        """Whether the journal has it; before that it is not offered."""
        self.custodian: int | None = None
        """Of an own sample: the custodian that has it as well."""

    @property
    def kept_at(self) -> int | None:
        """When it was published or taken here, ns; None: unknown.

        Time for which the node was off is left out where the clock does not tell it.
        """
        life_s = self.envelope.life_s
        return self.ends_at - seconds_to_ns(life_s) if life_s > 0 else None

    @property
    def identity(self) -> tuple[Bundle, int]:
        """What makes it this sample, whatever way it comes."""
        return self.envelope.bundle, self.envelope.number


class _StoredSample(msgspec.Struct, frozen=True, array_like=True):
    envelope: Envelope
    delivery_id: int | None
    custodian: int | None
    boot: bytes
    """The run of the monotonic clock that `ends_at` belongs to; empty: unknown."""
    ends_at: int
    life_ns: int
    """How long it had to live when it was written, ns."""


def stored_samples(stored: Mapping[str, bytes]) -> list[Held]:
    """Return the samples in a journal, in the order of publication.

    Raises:
        msgspec.MsgspecError: An entry is of another version.
    """
    return [held for held, _ in _read(stored)]


def _read(stored: Mapping[str, bytes]) -> Iterator[tuple[Held, _StoredSample]]:
    for key in sorted(stored, key=_place):
        kind, _, rest = key.partition("/")
        if kind != _SAMPLE:
            continue
        sample = msgspec.msgpack.decode(stored[key], type=_StoredSample)
        held = Held(int(rest), sample.envelope, sample.ends_at, sample.delivery_id)
        held.is_stored, held.custodian = True, sample.custodian
        yield held, sample


class Custody:
    """The samples of one node, in its journal.

    Args:
        journal: Holds them.
        stored: What the journal had at the start.
    """

    def __init__(self, journal: JournalPort, stored: Mapping[str, bytes]) -> None:
        self._journal = journal
        self._boot = stored.get(BOOT_KEY, b"")
        self._samples: dict[int, Held] = {}
        self._by_identity: dict[tuple[Bundle, int], Held] = {}
        self._next_number = 1
        self._left: dict[int, int] = {}
        self.carried_bytes = 0
        """Bytes of the samples that other nodes have published."""
        self.carried = 0
        """How many these are."""

    def recover(self, stored: Mapping[str, bytes]) -> Iterator[Held]:
        """Restore the samples from before the restart, and yield each."""
        for held, sample in _read(stored):
            if not self._boot or sample.boot != self._boot:
                # Another run of the clock: how long the node was down is not known.
                self._left[held.number] = sample.life_ns
            self._next_number = max(self._next_number, held.number + 1)
            self._add(held)
            yield held

    def begin(self, now: int) -> None:
        """Begin the lives of the samples from another run of the clock."""
        for number, life_ns in self._left.items():
            if number in self._samples:
                self._samples[number].ends_at = now + life_ns
        self._left.clear()

    def __iter__(self) -> Iterator[Held]:
        return iter(list(self._samples.values()))

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def is_dated(self) -> bool:
        """Whether the instants of all samples are of this run of the clock."""
        return not self._left

    def find(self, bundle: Bundle, number: int) -> Held | None:
        """Return a sample, or None."""
        return self._by_identity.get((bundle, number))

    def keep(
        self,
        envelope: Envelope,
        ends_at: int,
        now: int,
        *,
        delivery_id: int | None = None,
        then: Callable[[int], None],
    ) -> Held:
        """Keep a sample; `then` is called once the journal has it."""
        held = Held(self._next_number, envelope, ends_at, delivery_id)
        self._next_number += 1
        self._add(held)

        def stored(at: int) -> None:
            held.is_stored = True
            then(at)

        self._write(held, now, stored)
        return held

    def write(self, held: Held, now: int) -> None:
        """Journal a sample again: something about it has changed."""
        self._write(held, now, None)

    def renumber(self, held: Held, bundle: Bundle, number: int, now: int) -> None:
        """Give a sample another place in another count."""
        del self._by_identity[held.identity]
        held.envelope = msgspec.structs.replace(held.envelope, bundle=bundle, number=number)
        held.custodian = None
        self._by_identity[held.identity] = held
        self._write(held, now, None)

    def drop(self, held: Held) -> None:
        """Forget a sample."""
        if self._samples.pop(held.number, None) is None:
            return
        del self._by_identity[held.identity]
        if held.delivery_id is None:
            self.carried -= 1
            self.carried_bytes -= held.envelope.size_bytes
        self._journal.write(f"{_SAMPLE}/{held.number}", None)

    # Below the methods above

    def _add(self, held: Held) -> None:
        self._samples[held.number] = held
        self._by_identity[held.identity] = held
        if held.delivery_id is None:
            self.carried += 1
            self.carried_bytes += held.envelope.size_bytes

    def _write(self, held: Held, now: int, then: Callable[[int], None] | None) -> None:
        entry = _StoredSample(
            held.envelope,
            held.delivery_id,
            held.custodian,
            self._boot,
            held.ends_at,
            max(0, held.ends_at - now),
        )
        self._journal.write(f"{_SAMPLE}/{held.number}", msgspec.msgpack.encode(entry), then)


def _place(key: str) -> tuple[str, int]:
    """Return the order in which to restore: that of publication."""
    kind, _, rest = key.partition("/")
    return kind, int(rest) if kind == _SAMPLE else 0
