"""Commands about routes: ``@acoustic/3/routing?do=heard;run=7;via=2;within_s=60``.

The local gateway asks node 3, over node 2 (`zacoustic.core.transport.routing`). For its own node a
gateway answers itself.
"""

from typing import TYPE_CHECKING, Any, Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.streams.routing import ROUTING_TIMEOUT_S
from zacoustic.core.wire.routing import RoutingAnswer, RoutingKind, RoutingRequest
from zacoustic.zenoh.requests.context import Asking
from zacoustic.zenoh.requests.request import NUMBER, Parameter, Request, one_of

if TYPE_CHECKING:
    from zacoustic.core.engine.engine import Engine

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
    """Revision of the route's path; 0: the path is that of the file."""
    number: int = 0
    """Number that frames on that path have."""
    path: tuple[int, ...] = ()
    """The path of the route at that node."""
    over_s: int = 0
    """Time until the run of probes is over, s."""
    airtime_ms: int = 0
    """Airtime of a probe, ms."""
    heard: dict[int, int] = {}
    """Number of probes that were heard, by source."""

    @classmethod
    def of(cls, engine: "Engine", node: int, answer: RoutingAnswer) -> "RoutingReport":
        """Return the report of a node's answer to this engine."""
        sent_s = round(ns_to_seconds(engine.stats.airtime_ns), 3)
        fields = msgspec.structs.asdict(answer)
        return cls(address=node, by=engine.address, sent_s=sent_s, **fields)


def _begin(asking: Asking[RoutingRequest, RoutingReport], engine: "Engine", now: int) -> None:
    request, node = asking.question, asking.node

    def report(answer: RoutingAnswer) -> RoutingReport:
        return RoutingReport.of(asking.context.engine, node, answer)

    if node == engine.address:
        engine.routing.execute(request, now, lambda answer, at: asking.answer(report(answer)))
        return
    call_id = engine.routing.send(node, request, now, timeout_s=asking.within_s)
    maybe = "may have executed it" if request.changes else ""
    asking.wait(
        call_id, lambda end: report(RoutingAnswer.decode(request.kind, end.value)), maybe=maybe
    )


def _make(do: RoutingKind, **values: Any) -> RoutingRequest:  # noqa: ANN401 (fields of a request)
    allowed = (*_USED[do], "via")
    for name in values:
        if name not in allowed:
            listed = ", ".join((*allowed, "within_s"))
            raise ValueError(f"{name} is no parameter of do={do.name.lower()}; allowed: {listed}")
    if "route" in values:
        values["route_id"] = values.pop("route")
    return RoutingRequest(kind=do, **values)


def _tell(request: RoutingRequest) -> dict[str, object]:
    fields = {**msgspec.structs.asdict(request), "route": request.route_id}
    lists = {name: fields[name] or None for name in ("via", "path")}
    used = {name: fields[name] for name in _USED[request.kind]}
    return {"do": request.kind.name.lower(), **used, **lists}


def _addresses(text: str) -> tuple[int, ...] | None:
    numbers = [NUMBER.read(each) for each in text.split(",")]
    return None if None in numbers else tuple(numbers)


_LIST: Final = Parameter(_addresses, NUMBER.allowed)
_NUMBERS: Final = ("route", "revision", "number", "run", "count", "after")

ROUTING: Final = Request(
    subject="routing",
    parameters={
        "do": one_of({each.name.lower(): each for each in RoutingKind}, is_required=True),
        **dict.fromkeys(_NUMBERS, NUMBER),
        "path": _LIST,
        "via": _LIST,
    },
    make=_make,
    tell=_tell,
    answer=RoutingReport,
    begin=_begin,
    within_s=60.0,
    most_s=ROUTING_TIMEOUT_S,
)
"""Asks a node about routes, or changes one there."""
