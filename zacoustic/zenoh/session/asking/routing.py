"""Commands about routes as a Zenoh key: the query, and the JSON of its answer.

A `get` on ``@acoustic/3/routing?do=heard;run=7;via=2;within_s=60`` makes the local gateway ask node
3, over node 2 (`zacoustic.core.transport.routing`). For its own node a gateway answers itself.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.streams.routing import ROUTING_TIMEOUT_S
from zacoustic.core.wire.routing import RoutingKind, RoutingRequest
from zacoustic.text.digits import whole_number
from zacoustic.zenoh.session.asking.commands import ANY_NODE, PREFIX, node_in, time_limit_s

DEFAULT_ROUTING_S: Final = 60.0
"""Default time limit of an answer, s."""
ROUTING: Final = f"{PREFIX}/{ANY_NODE}/routing"
"""Key expression of the commands to all nodes."""
_WORDS: Final = {each.name.lower(): each for each in RoutingKind}
_NUMBERS: Final = {
    "route": "route_id",
    "revision": "revision",
    "number": "number",
    "run": "run",
    "count": "count",
    "after": "after",
}
_LISTS: Final = ("via", "path")
_USED: Final = {
    RoutingKind.ASK: ("route",),
    RoutingKind.SET: ("route", "revision", "number", "path"),
    RoutingKind.RESET: ("route", "revision"),
    RoutingKind.PROBE: ("run", "count"),
    RoutingKind.HEARD: ("run", "after"),
}


class RoutingReport(msgspec.Struct, frozen=True, kw_only=True):
    """The answer of a node, and what the asking node knows beside it."""

    address: int
    """The node that has answered."""
    by: int
    """The node that has asked; the same: it answers for itself."""
    sent_s: float
    """Airtime of the asking node since its start, s."""
    revision: int = 0
    """Of the path of the route; 0: it is that of the file."""
    number: int = 0
    """Number that frames on that path have."""
    path: tuple[int, ...] = ()
    """The path of the route at that node."""
    over_s: int = 0
    """The run of probes is over in so many seconds."""
    airtime_ms: int = 0
    """Airtime of a probe, ms."""
    heard: dict[int, int] = {}
    """How many probes were heard, by source."""


class RoutingAsked(msgspec.Struct, frozen=True, kw_only=True):
    """A command in a query."""

    node: int
    """The node that executes it."""
    request: RoutingRequest
    """The command; `via` has the nodes between."""
    within_s: float
    """Time limit, s."""


def routing_selector(node: int, request: RoutingRequest, within_s: float) -> tuple[str, str]:
    """Return key and parameters of a query."""
    words = [f"do={request.kind.name.lower()}"]
    used = _USED[request.kind]
    words += [f"{name}={getattr(request, _NUMBERS[name])}" for name in used if name in _NUMBERS]
    for name in _LISTS:
        addresses = getattr(request, name)
        if addresses:
            words.append(f"{name}={','.join(map(str, addresses))}")
    return f"{PREFIX}/{node}/routing", ";".join([*words, f"within_s={within_s:.10g}"])


def read_routing(key: str, parameters: Mapping[str, str]) -> RoutingAsked | None:
    """Read a command.

    Returns:
        The command, or None: the key browses.

    Raises:
        ValueError: Names a parameter, its value and the allowed values.
    """
    node = node_in(key, "routing")
    if node is None:
        return None
    said = {name: text for name, text in parameters.items() if not name.startswith("_")}
    word = said.pop("do", "")
    if word not in _WORDS:
        raise ValueError(f"do is {word or 'missing'}; allowed: {', '.join(_WORDS)}")
    kind = _WORDS[word]
    within_s = time_limit_s(said, DEFAULT_ROUTING_S, ROUTING_TIMEOUT_S)
    said.pop("within_s", None)
    fields: dict[str, int | tuple[int, ...]] = {}
    for name, text in said.items():
        if name not in (*_USED[kind], "via"):
            allowed = ", ".join((*_USED[kind], "via", "within_s"))
            raise ValueError(f"{name} is no parameter of {key}; allowed: {allowed}")
        if name in _LISTS:
            fields[name] = tuple(_number(name, each, text) for each in text.split(","))
        else:
            fields[_NUMBERS[name]] = _number(name, text, text)
    return RoutingAsked(
        node=node,
        request=RoutingRequest(kind=kind, **fields),  # type: ignore[arg-type]
        within_s=within_s,
    )


def _number(name: str, text: str, whole: str) -> int:
    number = whole_number(text.strip())
    if number is None:
        raise ValueError(f"{name} is {whole}; allowed: whole numbers")
    return number
