"""Notices of the engine's events, for those worth a line."""

from collections.abc import Callable
from typing import Any, Final

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.engine.events import (
    AccessStateChanged,
    AddressShared,
    BulkChanged,
    ClockStateChanged,
    CustodyChanged,
    DeadlineMissed,
    EngineRestarted,
    Event,
    JournalDoubted,
    JournalStateChanged,
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
from zacoustic.core.profiles.entities import RosEntitySeen
from zacoustic.core.streams.commands import CommandState
from zacoustic.core.streams.table import StreamTable
from zacoustic.zenoh.gateway.notices import (
    AccessChanged,
    AddressClash,
    BulkRerouted,
    ClockChanged,
    CustodyNotice,
    EngineLost,
    EntityHeard,
    JournalChanged,
    JournalInDoubt,
    LinkChanged,
    LinkUnheard,
    Notice,
    PeerBack,
    PeerHeard,
    PeerMissed,
    RangingFailed,
    ReachChanged,
    SampleLate,
    SealBroken,
    SilenceJournalled,
    StreamDiffers,
    Subscribed,
    TopicOverridden,
)
from zacoustic.zenoh.requests.commands import SilenceState
from zacoustic.zenoh.requests.context import RequestContext


class EventNotices:
    """Makes the notices of one gateway.

    Args:
        table: All streams.
        context: The gateway.
    """

    def __init__(self, table: StreamTable, context: RequestContext) -> None:
        self._table = table
        self._context = context
        self._runner = context.runner

    def of(self, event: Event) -> Notice | None:
        """Return the notice of an event; None: it is not worth one."""
        make = _MAKERS.get(type(event))
        return None if make is None else make(self, event)

    def _link(self, event: LinkStateChanged) -> Notice:
        sides = self._runner.sides
        if len(sides) == 1:
            return LinkChanged(state=event.state.value, detail=sides[0].detail)
        detail = self._runner.side(event.link).detail
        return LinkChanged(state=event.state.value, detail=detail, link=event.link)

    def _silence(self, event: SilenceChanged) -> Notice:
        context, left_s = self._context, None
        if event.ends_at is not None:
            left_s = ns_to_seconds(event.ends_at - context.clock())
        state = CommandState(silent=event.is_silent, commanded=event.is_commanded, left_s=left_s)
        said = SilenceState.of(context, context.engine.address, None, state)
        return SilenceJournalled(
            silent=said.silent, until_utc=said.until_utc or "", doubt=event.doubt
        )

    def _overridden(self, event: StreamOverridden) -> Notice:
        return TopicOverridden(
            stream_id=event.stream_id,
            stream=self._table.by_id(event.stream_id).name,
            on=event.on,
            min_interval_s=event.min_interval_s,
            priority=event.priority.name.lower(),
            commanded_by=event.commanded_by,
        )

    def _restarted(self, event: EngineRestarted) -> Notice:
        return EngineLost(faults=event.faults, cause=event.cause)

    def _journal(self, event: JournalStateChanged) -> Notice:
        return JournalChanged(failure=event.failure)

    def _doubt(self, event: JournalDoubted) -> Notice:
        return JournalInDoubt(reason=event.reason)

    def _shared(self, event: AddressShared) -> Notice:
        return AddressClash(
            address=event.address,
            name=self._node(event.address),
            is_own=event.address == self._runner.engine.address,
        )

    def _seal(self, event: SealAlarm) -> Notice:
        stream = None if event.stream_id is None else self._table.get(event.stream_id)
        return SealBroken(
            address=event.address,
            name=self._node(event.address),
            refusal=event.refusal.value,
            frames=event.frames,
            is_too_many=event.is_too_many,
            stream="" if stream is None else stream.name,
        )

    def _unheard(self, event: NothingHeard) -> Notice:
        return LinkUnheard(frames=event.frames)

    def _access(self, event: AccessStateChanged) -> Notice:
        return AccessChanged(
            method=event.state.method,
            why=event.state.why,
            faults=tuple((each.node, each.trouble.value, each.by_s) for each in event.state.faults),
        )

    def _bulk(self, event: BulkChanged) -> Notice:
        return BulkRerouted(
            address=event.address, name=self._node(event.address), works=event.works
        )

    def _clock(self, event: ClockStateChanged) -> Notice:
        return ClockChanged(doubt=event.doubt)

    def _seen(self, event: PeerSeen) -> Notice:
        return PeerHeard(
            address=event.address,
            name=self._node(event.address),
            epoch=event.epoch,
            same_table=event.same_table,
            wire_version=event.wire_version,
        )

    def _lost(self, event: PeerLost) -> Notice:
        return PeerMissed(address=event.address, name=self._node(event.address))

    def _found(self, event: PeerFound) -> Notice:
        return PeerBack(address=event.address, name=self._node(event.address))

    def _reach(self, event: PeerReachable) -> Notice:
        return ReachChanged(
            address=event.address,
            name=self._node(event.address),
            link=event.link,
            bond=event.bond,
            reach=event.reach.value,
        )

    def _custody(self, event: CustodyChanged) -> Notice:
        return CustodyNotice(
            stream=self._table.by_id(event.stream_id).name,
            subscriber=event.subscriber,
            custodian=event.custodian,
            detail=event.detail,
        )

    def _subscribers(self, event: SubscribersChanged) -> Notice:
        name = self._table.by_id(event.stream_id).name
        return Subscribed(stream=name, subscribers=event.subscribers)

    def _late(self, event: DeadlineMissed) -> Notice | None:
        if not event.is_first:
            return None  # it has had its notice, and the health report counts the rest
        return SampleLate(
            stream=event.key, address=event.source, side=event.side.value, missed=event.missed
        )

    def _differ(self, event: StreamsDiffer) -> Notice:
        stream = self._table.get(event.stream_id)
        return StreamDiffers(
            address=event.address,
            stream_id=event.stream_id,
            stream=stream.name if stream is not None else "",
        )

    def _ranging(self, event: RangeFailed) -> Notice:
        return RangingFailed(address=event.address, text=event.text)

    def _entity(self, event: RosEntitySeen) -> Notice:
        return EntityHeard(
            node=f"{event.namespace.rstrip('/')}/{event.node}",
            kind=event.kind.name.lower(),
            topic=event.topic,
            type=event.type,
            leaves=event.leaves,
        )

    def _node(self, address: int) -> str:
        return self._table.nodes.get(address, "")


_MAKERS: Final[dict[type[Any], Callable[[EventNotices, Any], Notice | None]]] = {
    LinkStateChanged: EventNotices._link,
    SilenceChanged: EventNotices._silence,
    StreamOverridden: EventNotices._overridden,
    EngineRestarted: EventNotices._restarted,
    JournalStateChanged: EventNotices._journal,
    JournalDoubted: EventNotices._doubt,
    AddressShared: EventNotices._shared,
    SealAlarm: EventNotices._seal,
    NothingHeard: EventNotices._unheard,
    AccessStateChanged: EventNotices._access,
    BulkChanged: EventNotices._bulk,
    ClockStateChanged: EventNotices._clock,
    PeerSeen: EventNotices._seen,
    PeerLost: EventNotices._lost,
    PeerFound: EventNotices._found,
    PeerReachable: EventNotices._reach,
    CustodyChanged: EventNotices._custody,
    SubscribersChanged: EventNotices._subscribers,
    DeadlineMissed: EventNotices._late,
    StreamsDiffer: EventNotices._differ,
    RangeFailed: EventNotices._ranging,
    RosEntitySeen: EventNotices._entity,
}
TOLD: Final = tuple(_MAKERS)
"""The types of events that are worth a notice."""
