"""Receipts and refusals on their way back to the publisher, in the journal.

An answer goes back the way that its samples came: by the node that handed them over last. Where
that node is out of reach, other custodians take the answer as well, and each passes it on if it
meets the publisher.
"""

from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.transport.carry.custody import Offered
from zacoustic.core.wire.carry import Bundle, CarryRefusal, Receipt

_ANSWER: Final = "carryback"
_WAY: Final = "carryway"


class CarryAnswer(Offered):
    """A receipt or refusal on its way to a publisher.

    Args:
        content: The receipt or refusal.
        life_ns: How long it is worth the way, ns.
    """

    __slots__ = ("content", "ends_at", "life_ns")

    def __init__(self, content: Receipt | CarryRefusal, life_ns: int) -> None:
        super().__init__()
        self.content = content
        self.life_ns = life_ns
        self.ends_at: int | None = None
        """When it is worthless, ns; None: its life has not begun."""


class _Stored(msgspec.Struct, frozen=True, array_like=True):
    receipt: Receipt | None
    refusal: CarryRefusal | None
    life_ns: int


class Answers:
    """The answers that a node has for others.

    Args:
        journal: Holds them.
    """

    def __init__(self, journal: JournalPort) -> None:
        self._journal = journal
        self._answers: dict[tuple[Bundle, int | None], CarryAnswer] = {}
        self._ways: dict[tuple[int, int], int] = {}
        """By stream id and publisher, the node by which its samples came last."""

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore everything from before the restart."""
        for key, value in sorted(stored.items()):
            kind, _, rest = key.partition("/")
            if kind == _ANSWER:
                entry = msgspec.msgpack.decode(value, type=_Stored)
                content = entry.receipt or entry.refusal
                if content is not None:
                    self._answers[_key_of(content)] = CarryAnswer(content, entry.life_ns)
            elif kind == _WAY:
                stream_id, _, origin = rest.partition("/")
                self._ways[int(stream_id), int(origin)] = value[0]

    def begin(self, now: int) -> None:
        """Begin the lives of the answers from before the restart: its length is not known."""
        for answer in self:
            if answer.ends_at is None:
                answer.ends_at = now + answer.life_ns

    def __iter__(self) -> Iterator[CarryAnswer]:
        return iter(list(self._answers.values()))

    def __len__(self) -> int:
        return len(self._answers)

    def came_by(self, bundle: Bundle, node: int) -> None:
        """Note which node has handed over a sample."""
        place = bundle.stream_id, bundle.origin
        if self._ways.get(place) != node:
            self._ways[place] = node
            self._journal.write(_way_name(*place), bytes((node,)))

    def way(self, bundle: Bundle) -> int | None:
        """Return the node by which the samples of a publisher came; None: none came here."""
        return self._ways.get((bundle.stream_id, bundle.origin))

    def find(self, content: Receipt | CarryRefusal) -> CarryAnswer | None:
        """Return the answer that another one would replace, or None."""
        return self._answers.get(_key_of(content))

    def keep(self, content: Receipt | CarryRefusal, life_ns: int, now: int) -> None:
        """Keep an answer, in place of an older one."""
        key = _key_of(content)
        answer = self._answers[key] = CarryAnswer(content, life_ns)
        answer.ends_at = now + life_ns
        entry = _Stored(
            content if isinstance(content, Receipt) else None,
            content if isinstance(content, CarryRefusal) else None,
            life_ns,
        )
        self._journal.write(_name(key), msgspec.msgpack.encode(entry))

    def drop(self, answer: CarryAnswer) -> None:
        """Forget an answer."""
        key = _key_of(answer.content)
        if self._answers.get(key) is answer:
            del self._answers[key]
            self._journal.write(_name(key), None)

    def forget(self, origin: int) -> None:
        """Forget by which way the samples of a node came."""
        for place in [each for each in self._ways if each[1] == origin]:
            del self._ways[place]
            self._journal.write(_way_name(*place), None)


def _key_of(content: Receipt | CarryRefusal) -> tuple[Bundle, int | None]:
    """Return what an answer replaces: of a count only the newest receipt matters."""
    return content.bundle, None if isinstance(content, Receipt) else content.number


def _name(key: tuple[Bundle, int | None]) -> str:
    bundle, number = key
    parts = (
        bundle.origin, bundle.destination, bundle.stream_id, bytes(bundle.instance).hex(),
        bundle.lineage, "" if number is None else number,
    )  # fmt: skip
    return "/".join((_ANSWER, *map(str, parts)))


def _way_name(stream_id: int, origin: int) -> str:
    return f"{_WAY}/{stream_id}/{origin}"
