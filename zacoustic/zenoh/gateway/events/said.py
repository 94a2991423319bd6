"""What the events of an engine say: one table, with a line of text and the members in JSON.

An event that is not in it is not worth a line; others take it (`dispatcher`).
"""

from enum import Enum
from functools import singledispatch
from typing import Any, Final

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.engine.events import (
    AccessStateChanged,
    AddressShared,
    BulkChanged,
    ClockStateChanged,
    CustodyChanged,
    DeadlineMissed,
    DeadlineSide,
    EngineRestarted,
    JournalDoubted,
    JournalStateChanged,
    LinkState,
    LinkStateChanged,
    NothingHeard,
    PeerFound,
    PeerLost,
    PeerReachable,
    PeerSeen,
    SealAlarm,
    SilenceChanged,
    StreamOverridden,
    StreamsDiffer,
    SubscribersChanged,
)
from zacoustic.core.peers.ranging import RangeFailed
from zacoustic.core.peers.sealing import SealRefusal
from zacoustic.core.profiles.entities import RosEntitySeen
from zacoustic.core.schedule.access.base import Trouble
from zacoustic.core.streams.commands import CommandState
from zacoustic.zenoh.gateway.notices import Notice, notice
from zacoustic.zenoh.requests.commands import SilenceState
from zacoustic.zenoh.requests.context import RequestContext

FORBIDDEN: Final = "it sends what it may not send"
"""Description of an authentic node that sends what the table does not allow."""
_REFUSALS: Final = {
    SealRefusal.UNSEALED: "its frames are not sealed",
    SealRefusal.FORGED: "its frames do not open: another key, or not from it",
    SealRefusal.FORMER_LIFE: "it transmits with an earlier life: old records, or a recording of it",
    SealRefusal.CLONE: "another computer has this key and address; nothing is transmitted any more",
    SealRefusal.FORBIDDEN: FORBIDDEN,
    SealRefusal.COSTLY: "it has spent security.reply_share: answers to it wait",
}
_TROUBLES: Final = {
    Trouble.OUTSIDE: "transmits {:.2f} s outside its slots: its clock is wrong or it has others",
    Trouble.FAR: "is {:.2f} s farther away than a guard: the own slot is used that much less",
    Trouble.SHARED: "owns a slot of this node and is heard: they use it in turns",
}


@singledispatch
def said(event: object, context: RequestContext) -> Notice | None:
    """Return what an event says; None: it is not worth a line.

    Args:
        event: The event.
        context: The gateway.
    """
    return None


@said.register
def _(event: LinkStateChanged, context: RequestContext) -> Notice:
    runner, state = context.runner, event.state.value
    link = event.link if len(runner.sides) > 1 else ""
    detail = runner.side(event.link).detail if link else runner.sides[0].detail
    words = " ".join(filter(None, (link, state, detail)))
    is_trouble = event.state is not LinkState.UP
    return notice("link", words, is_trouble=is_trouble, state=state, detail=detail, link=link)


@said.register
def _(event: SilenceChanged, context: RequestContext) -> Notice:
    left_s = None
    if event.ends_at is not None:
        left_s = ns_to_seconds(event.ends_at - context.clock())
    state = CommandState(silent=event.is_silent, commanded=event.is_commanded, left_s=left_s)
    now = SilenceState.of(context, context.engine.address, None, state)
    doubt = f" ({event.doubt})" if event.doubt else ""
    words = f"until {now.until_utc or 'it is resumed'}{doubt}" if now.silent else "ended"
    return notice(
        "silence", words, silent=now.silent, until_utc=now.until_utc or "", doubt=event.doubt
    )


@said.register
def _(event: StreamOverridden, context: RequestContext) -> Notice:
    facts = _facts(event, context, "stream_id", "stream", "on", "min_interval_s", "commanded_by")
    priority, interval_s, by = event.priority.name.lower(), event.min_interval_s, event.commanded_by
    state = "on" if event.on else "off"
    state += f", every {interval_s:g} s at most" if interval_s else ""
    who = f"node {by}" if by else "this local network"
    words = f"{event.stream_id} ({facts['stream']}): {state}, {priority}, by {who}"
    return notice("overridden", words, head="tuned", priority=priority, **facts)


@said.register
def _(event: EngineRestarted, context: RequestContext) -> Notice:
    words = f"error {event.faults}, please report the log; it goes on: {event.cause}"
    facts = _facts(event, context, "faults", "cause")
    return notice("internal_error", words, head="internal", is_trouble=True, **facts)


@said.register
def _(event: JournalStateChanged, context: RequestContext) -> Notice:
    why = event.failure
    words = f"fails, what is reliable waits: {why}" if why else "can be written again"
    return notice("journal", words, is_trouble=bool(why), failure=why)


@said.register
def _(event: JournalDoubted, context: RequestContext) -> Notice:
    words = f"in doubt, a new boot epoch continues with its valid part: {event.reason}"
    return notice("journal_in_doubt", words, head="journal", is_trouble=True, reason=event.reason)


@said.register
def _(event: AddressShared, context: RequestContext) -> Notice:
    is_own = event.address == context.engine.address
    whose = "this one and another" if is_own else "two nodes"
    words = f"{_node(context, event.address)}: {whose} have it; samples of the two mix and get lost"
    return notice(
        "address_shared", f"{words}: give each its own", head="address", is_trouble=True,
        is_own=is_own, **_facts(event, context, "address"),
    )  # fmt: skip


@said.register
def _(event: SealAlarm, context: RequestContext) -> Notice:
    facts = _facts(event, context, "address", "refusal", "frames", "is_too_many", "stream")
    what = f": {facts['stream']}" if event.refusal is SealRefusal.FORBIDDEN else ""
    words = f"{_node(context, event.address)}: {_REFUSALS[event.refusal]}{what} ({event.frames})"
    rotate = "; rotate the key" if event.is_too_many else ""
    return notice("seal", words + rotate, is_trouble=True, **facts)


@said.register
def _(event: NothingHeard, context: RequestContext) -> Notice:
    words = f"{event.frames} frames sent and none heard; ask zacoustic config doctor"
    return notice("unheard", words, is_trouble=True, frames=event.frames)


@said.register
def _(event: AccessStateChanged, context: RequestContext) -> Notice:
    state = event.state
    lines = [f"{state.method}: {state.why}"] if state.why else []
    lines += [
        f"node {each.node} {_TROUBLES[each.trouble].format(each.by_s)}" for each in state.faults
    ]
    faults = [(each.node, each.trouble.value, each.by_s) for each in state.faults]
    return notice(
        "access", *(lines or [state.method]), is_trouble=state.is_trouble,
        method=state.method, why=state.why, faults=faults,
    )  # fmt: skip


@said.register
def _(event: BulkChanged, context: RequestContext) -> Notice:
    name = context.engine.table.nodes.get(event.address, "")
    node = f"{name} ({event.address})" if name else str(event.address)
    words = f"fast data do not get through to {node}; large samples go slowly"
    if event.works:
        words = f"large samples to {node} go fast again"
    facts = _facts(event, context, "address", "works")
    return notice("bulk", words, is_trouble=not event.works, **facts)


@said.register
def _(event: ClockStateChanged, context: RequestContext) -> Notice:
    words = f"nothing is transmitted: {event.doubt}" if event.doubt else "sure"
    return notice("clock", words, is_trouble=bool(event.doubt), doubt=event.doubt)


@said.register
def _(event: PeerSeen, context: RequestContext) -> Notice:
    table = "the same table" if event.same_table else "another table"
    words = f"{_node(context, event.address)} with {table}, epoch {event.epoch}"
    facts = _facts(event, context, "address", "epoch", "same_table", "wire_version")
    return notice("peer", words, is_trouble=not event.same_table, **facts)


@said.register
def _(event: PeerLost, context: RequestContext) -> Notice:
    words = f"{_node(context, event.address)}: not heard any more"
    return notice("lost", words, is_trouble=True, **_facts(event, context, "address"))


@said.register
def _(event: PeerFound, context: RequestContext) -> Notice:
    return notice("found", _node(context, event.address), **_facts(event, context, "address"))


@said.register
def _(event: PeerReachable, context: RequestContext) -> Notice:
    words = f"{_node(context, event.address)} by {event.link}: {event.reach.value}"
    return notice("reach", words, **_facts(event, context, "address", "link", "bond", "reach"))


@said.register
def _(event: CustodyChanged, context: RequestContext) -> Notice:
    facts = _facts(event, context, "stream", "subscriber", "custodian", "detail")
    is_alone = event.custodian is None
    what = event.detail if is_alone else f"in custody of {event.custodian}"
    words = f"{facts['stream']} for {event.subscriber}: {what}"
    return notice("custody", words, is_trouble=is_alone, **facts)


@said.register
def _(event: SubscribersChanged, context: RequestContext) -> Notice:
    facts = _facts(event, context, "stream", "subscribers")
    words = f"{facts['stream']} by {', '.join(map(str, event.subscribers)) or 'nobody'}"
    return notice("subscribers", words, head="wanted", **facts)


@said.register
def _(event: DeadlineMissed, context: RequestContext) -> Notice | None:
    if not event.is_first:
        return None  # it has had its notice, and the health report counts the rest
    what = "not published" if event.side is DeadlineSide.OFFERED else "nothing has come"
    words = f"{event.key} of node {event.source}: {what} in time ({event.missed})"
    return notice(
        "late", words, is_trouble=True, stream=event.key, address=event.source,
        **_facts(event, context, "side", "missed"),
    )  # fmt: skip


@said.register
def _(event: StreamsDiffer, context: RequestContext) -> Notice:
    facts = _facts(event, context, "stream_id", "stream")
    what = facts["stream"] or "a stream that is not in this file"
    words = f"{event.stream_id} ({what}) at node {event.address}: stopped"
    return notice("differs", words, is_trouble=True, address=event.address, **facts)


@said.register
def _(event: RangeFailed, context: RequestContext) -> Notice:
    words = f"node {event.address}: {event.text}"
    return notice("ranging", words, is_trouble=True, address=event.address, text=event.text)


@said.register
def _(event: RosEntitySeen, context: RequestContext) -> Notice:
    node, kind = f"{event.namespace.rstrip('/')}/{event.node}", event.kind.name.lower()
    what = "leaves" if event.leaves else f"{event.topic} {event.type}"
    facts = _facts(event, context, "topic", "type", "leaves")
    return notice("entity", f"{node}: {kind} {what}", node=node, kind=kind, **facts)


TOLD: Final = tuple(kind for kind in said.registry if kind is not object)
"""The types of events that are worth a notice."""


def _facts(event: Any, context: RequestContext, *names: str) -> dict[str, Any]:  # noqa: ANN401
    """Return members of an event as JSON has them.

    Args:
        event: The event.
        context: The gateway.
        names: The members: ``address`` brings the node's name, ``stream`` is the name of the
            stream with the event's `stream_id`.
    """
    table, found = context.engine.table, {}
    for name in names:
        if name == "stream":
            stream = None if event.stream_id is None else table.get(event.stream_id)
            found[name] = "" if stream is None else stream.name
            continue
        value = getattr(event, name)
        found[name] = value.value if isinstance(value, Enum) else value
        if name == "address":
            found["name"] = table.nodes.get(value, "")
    return found


def _node(context: RequestContext, address: int) -> str:
    return f"{address} {context.engine.table.nodes.get(address, '')}".rstrip()
