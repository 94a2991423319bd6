"""Requests and answers of commands about routes (`ROUTING_STREAM_ID`).

A request names the nodes over which it goes, since a command crosses one hop only; each of them
takes itself off the list and calls the next one. `docs/wire.md` has the bytes.
"""

import enum
from collections.abc import Mapping
from typing import Final, Self

import msgspec

from zacoustic.core.streams.commands import SERIALS
from zacoustic.core.wire.relay import LAST_ROUTE, MOST_PROBES

MOST_VIA: Final = 14
"""The most nodes between the one that commands and the one that executes."""
REVISIONS: Final = SERIALS
"""Revisions of a route are modulo this; one is later than another if it is less than half ahead."""
MOST_SOURCES: Final = 10
"""The most counts in one answer."""
_LEAST_PATH: Final = 2
_MOST_PATH: Final = 16
_LAST_ADDRESS: Final = 254


class RoutingKind(enum.IntEnum):
    """What is asked for."""

    ASK = 0
    """The path of a route."""
    SET = 1
    """Another path for a route."""
    RESET = 2
    """The path of the file for a route."""
    PROBE = 3
    """A run of probes."""
    HEARD = 4
    """How many probes of a run were heard."""


class RoutingRequest(msgspec.Struct, frozen=True, kw_only=True):
    """One command about routes, or a question.

    Raises:
        ValueError: States field, value and what is allowed.
    """

    kind: RoutingKind
    """What is asked for."""
    via: tuple[int, ...] = ()
    """Addresses of the nodes to which it still goes, in order; empty: its receiver executes it."""
    route_id: int = 0
    """For ASK, SET and RESET: number of the route, 1…31."""
    revision: int = 0
    """For SET and RESET: later than that of all earlier changes of the route, 0…65535."""
    number: int = 0
    """For SET: number that frames on the new path have, 1…31."""
    path: tuple[int, ...] = ()
    """For SET: the addresses of the new path, 2…16 different ones."""
    run: int = 0
    """For PROBE and HEARD: number of the run, 0…255."""
    count: int = 0
    """For PROBE: how many, 1…32."""
    after: int = 0
    """For HEARD: only of nodes with higher addresses, 0…254."""

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            ValueError: States field, value and what is allowed.
        """
        if len(self.via) > MOST_VIA:
            raise ValueError(f"via has {len(self.via)} nodes; allowed: at most {MOST_VIA}")
        for each in self.via:
            _check("via", each, 1, _LAST_ADDRESS)
        match self.kind:
            case RoutingKind.ASK | RoutingKind.SET | RoutingKind.RESET:
                _check("route", self.route_id, 1, LAST_ROUTE)
                _check("revision", self.revision, 0, REVISIONS - 1)
            case RoutingKind.PROBE:
                _check("run", self.run, 0, 255)
                _check("count", self.count, 1, MOST_PROBES)
            case RoutingKind.HEARD:
                _check("run", self.run, 0, 255)
                _check("after", self.after, 0, _LAST_ADDRESS)
        if self.kind is RoutingKind.SET:
            _check("number", self.number, 1, LAST_ROUTE)
            check_path(self.path)

    @property
    def changes(self) -> bool:
        """Whether it changes a route."""
        return self.kind in (RoutingKind.SET, RoutingKind.RESET)

    def encode(self) -> bytes:
        """Return the request."""
        head = bytes((len(self.via), *self.via, self.kind))
        match self.kind:
            case RoutingKind.ASK:
                return head + bytes((self.route_id,))
            case RoutingKind.SET:
                rest = bytes((self.number, *self.path))
                return head + bytes((self.route_id,)) + _revision(self.revision) + rest
            case RoutingKind.RESET:
                return head + bytes((self.route_id,)) + _revision(self.revision)
            case RoutingKind.PROBE:
                return head + bytes((self.run, self.count))
            case RoutingKind.HEARD:
                return head + bytes((self.run, self.after))

    @classmethod
    def decode(cls, request: bytes) -> Self:
        """Return the request in these bytes.

        Raises:
            ValueError: They are none.
        """
        via = tuple(request[1 : 1 + request[0]]) if request else ()
        body = request[1 + len(via) :]
        if not body or len(via) < request[0]:
            raise ValueError("the request is cut short")
        kind, fields = RoutingKind(body[0]), body[1:]
        lengths = {
            RoutingKind.ASK: (1, 1),
            RoutingKind.SET: (4 + _LEAST_PATH, 4 + _MOST_PATH),
            RoutingKind.RESET: (3, 3),
        }
        least, most = lengths.get(kind, (2, 2))
        if not least <= len(fields) <= most:
            raise ValueError(f"a request of {len(request)} bytes; allowed: as docs/wire.md says")
        match kind:
            case RoutingKind.PROBE:
                return cls(kind=kind, via=via, run=fields[0], count=fields[1])
            case RoutingKind.HEARD:
                return cls(kind=kind, via=via, run=fields[0], after=fields[1])
        revision = int.from_bytes(fields[1:3], "big")
        is_set = kind is RoutingKind.SET
        return cls(
            kind=kind,
            via=via,
            route_id=fields[0],
            revision=revision,
            number=fields[3] if is_set else 0,
            path=tuple(fields[4:]),
        )


class RoutingAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to a request."""

    revision: int = 0
    """Of the path of the route, 0…65535; 0: it is that of the file."""
    number: int = 0
    """Number that frames on that path have."""
    path: tuple[int, ...] = ()
    """The path of the route at that node."""
    over_s: int = 0
    """The run of probes is over in so many seconds."""
    airtime_ms: int = 0
    """Airtime of a probe, ms."""
    heard: Mapping[int, int] = {}
    """How many probes were heard, by source."""

    def encode(self, kind: RoutingKind) -> bytes:
        """Return the answer to a request of that kind."""
        match kind:
            case RoutingKind.PROBE:
                return self.over_s.to_bytes(2, "big") + self.airtime_ms.to_bytes(2, "big")
            case RoutingKind.HEARD:
                return b"".join(bytes(pair) for pair in self.heard.items())
        return _revision(self.revision) + bytes((self.number, *self.path))

    @classmethod
    def decode(cls, kind: RoutingKind, answer: bytes) -> Self:
        """Return the answer to a request of that kind.

        Raises:
            ValueError: It is none.
        """
        match kind:
            case RoutingKind.PROBE:
                if len(answer) == 4:
                    over_s, airtime_ms = (
                        int.from_bytes(answer[at : at + 2], "big") for at in (0, 2)
                    )
                    return cls(over_s=over_s, airtime_ms=airtime_ms)
            case RoutingKind.HEARD:
                if len(answer) % 2 == 0:
                    return cls(heard=dict(zip(answer[::2], answer[1::2], strict=True)))
            case _:
                if 3 + _LEAST_PATH <= len(answer) <= 3 + _MOST_PATH:
                    revision = int.from_bytes(answer[:2], "big")
                    return cls(revision=revision, number=answer[2], path=tuple(answer[3:]))
        raise ValueError(f"an answer of {len(answer)} bytes; allowed: as docs/wire.md says")


def check_path(path: tuple[int, ...]) -> None:
    """Check that a path has 2…16 different addresses.

    Raises:
        ValueError: It has not.
    """
    if not _LEAST_PATH <= len(path) <= _MOST_PATH or len(set(path)) < len(path):
        raise ValueError(
            f"path is {list(path)}; allowed: {_LEAST_PATH}..{_MOST_PATH} addresses, each once"
        )
    for each in path:
        _check("path", each, 1, _LAST_ADDRESS)


def _revision(revision: int) -> bytes:
    return revision.to_bytes(2, "big")


def _check(name: str, value: int, least: int, most: int) -> None:
    if not least <= value <= most:
        raise ValueError(f"{name} is {value}; allowed: {least}..{most}")
