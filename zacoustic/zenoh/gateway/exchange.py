"""The event dispatcher: events of the engine go to their handlers, local input to the engine."""

from collections.abc import Callable
from typing import assert_never

from zacoustic.core.base.linktypes import ModemRead, PeerMeasured
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    ClockStateChanged,
    DeadlineMissed,
    DeliveryEnded,
    DeliveryStored,
    EngineRestarted,
    Event,
    JournalDoubted,
    JournalStateChanged,
    LinkStateChanged,
    NothingHeard,
    PeerFound,
    PeerLost,
    PeerSeen,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
    SilenceChanged,
    StreamsDiffer,
    StreamTuned,
    SubscribersChanged,
    TransportEvent,
)
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.profiles.entities import RosEntitySeen
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.news import ActionEvent
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.zenoh.gateway.commands.objects import ObjectDesk
from zacoustic.zenoh.gateway.commands.orders import OrderDesk
from zacoustic.zenoh.gateway.commands.pings import PingDesk
from zacoustic.zenoh.gateway.notices import (
    ClockChanged,
    EngineLost,
    EntityHeard,
    JournalChanged,
    JournalInDoubt,
    LinkChanged,
    LinkUnheard,
    Notify,
    PeerBack,
    PeerHeard,
    PeerMissed,
    RangingFailed,
    SampleLate,
    SilenceKept,
    StreamDiffers,
    Subscribed,
    TopicTuned,
)
from zacoustic.zenoh.gateway.status.health import Health
from zacoustic.zenoh.gateway.streams.actions import Actions
from zacoustic.zenoh.gateway.streams.services import Services
from zacoustic.zenoh.gateway.streams.topics import Topics


class Exchange:
    """Between one engine and one local network; for the loop.

    Args:
        table: All streams.
        topics: Takes samples.
        services: Takes requests and answers.
        actions: Takes events about goals.
        objects: Takes note of how far large samples are.
        health: Takes note of the rest.
        orders: Answers remote commands.
        pings: Takes answers to pings.
        detail: Returns the link's detail of its state.
        notify: Told what people want to know.
    """

    def __init__(
        self,
        table: StreamTable,
        *,
        topics: Topics,
        services: Services,
        actions: Actions,
        objects: ObjectDesk,
        health: Health,
        orders: OrderDesk,
        pings: PingDesk,
        detail: Callable[[], str],
        notify: Notify,
    ) -> None:
        self._table = table
        self._topics = topics
        self._services = services
        self._actions = actions
        self._objects = objects
        self._health = health
        self._orders = orders
        self._pings = pings
        self._detail = detail
        self._notify = notify

    def deliver(self, event: Event) -> None:
        """Take an event of the engine."""
        if isinstance(event, ActionEvent):
            self._actions.deliver(event)
            self._health.touch()
            return
        match event:
            case SampleReceived():
                self._topics.deliver(event)
                self._health.note_sample(event)
            case RequestReceived():
                self._services.serve(event)
            case ResponseReceived() if self._orders.has_sent(event.call_id):
                self._orders.respond(event)
            case CallFailed() if self._orders.has_sent(event.call_id):
                self._orders.fail(event)
            case ResponseReceived() | CallFailed() if self._pings.has_sent(event.call_id):
                self._pings.answered(event)
            case RangeMeasured() | RangeFailed() if self._pings.has_asked(event.range_id):
                self._pings.ranged(event)
            case ResponseReceived():
                self._services.respond(event)
            case CallFailed():
                self._services.fail(event)
            case LinkStateChanged():
                self._notify(LinkChanged(state=event.state.value, detail=self._detail()))
            case SilenceChanged():
                state = self._orders.silence(event)
                self._notify(
                    SilenceKept(
                        silent=state.silent, until_utc=state.until_utc or "", doubt=event.doubt
                    )
                )
            case StreamTuned():
                self._notify(
                    TopicTuned(
                        stream_id=event.stream_id,
                        stream=self._table.by_id(event.stream_id).name,
                        on=event.on,
                        min_interval_s=event.min_interval_s,
                        priority=event.priority.name.lower(),
                        ordered_by=event.ordered_by,
                    )
                )
            case EngineRestarted():
                self._notify(EngineLost(faults=event.faults, cause=event.cause))
            case JournalStateChanged():
                self._notify(JournalChanged(failure=event.failure))
            case JournalDoubted():
                self._notify(JournalInDoubt(reason=event.reason))
            case NothingHeard():
                self._notify(LinkUnheard(frames=event.frames))
            case ClockStateChanged():
                self._notify(ClockChanged(doubt=event.doubt))
            case PeerSeen():
                self._health.note_peer(event)
                self._notify(
                    PeerHeard(
                        address=event.address,
                        name=self._name(event.address),
                        epoch=event.epoch,
                        same_table=event.same_table,
                        wire_version=event.wire_version,
                    )
                )
            case PeerLost():
                self._notify(PeerMissed(address=event.address, name=self._name(event.address)))
            case PeerFound():
                self._notify(PeerBack(address=event.address, name=self._name(event.address)))
            case SubscribersChanged():
                name = self._table.by_id(event.stream_id).name
                self._notify(Subscribed(stream=name, subscribers=event.subscribers))
            case DeadlineMissed(is_first=True):
                self._notify(
                    SampleLate(
                        stream=event.key,
                        address=event.source,
                        side=event.side.value,
                        missed=event.missed,
                    )
                )
            case DeadlineMissed():
                pass  # it has its notice, and the health report counts
            case StreamsDiffer():
                self._health.note_difference(event)
                stream = self._table.get(event.stream_id)
                self._notify(
                    StreamDiffers(
                        address=event.address,
                        stream_id=event.stream_id,
                        stream=stream.name if stream is not None else "",
                    )
                )
            case RangeFailed():
                self._notify(RangingFailed(address=event.address, text=event.text))
            case PeerMeasured() | ModemRead() | RangeMeasured():
                pass  # the engine keeps it, and the health report asks there
            case DeliveryEnded():
                self._health.note_delivery(event)
            case ObjectProgress():
                self._objects.note(event)
            case RosEntitySeen():
                self._notify(
                    EntityHeard(
                        node=f"{event.namespace.rstrip('/')}/{event.node}",
                        kind=event.kind.name.lower(),
                        topic=event.topic,
                        type=event.type,
                        leaves=event.leaves,
                    )
                )
            case DeliveryStored() | TransportEvent():
                pass  # for who publishes in this process, or has a transport of its own here
            case _:
                assert_never(event)
        self._health.touch()

    def drain(self, engine: Engine, now: int) -> None:
        """Give the engine the local input: samples, answers to calls."""
        self._topics.drain(engine, now)
        self._services.drain(engine, now)
        self._health.touch()

    def _name(self, address: int) -> str:
        return self._table.nodes.get(address, "")
