"""The takers of the engine's events in a gateway."""

from typing import get_args

from zacoustic.core.base.linktypes import ModemRead, PeerMeasured
from zacoustic.core.engine.events import (
    CallFailed,
    CommandHandled,
    ContactLost,
    ContactRestored,
    DeliveryEnded,
    DeliveryStored,
    EngineRestarted,
    Event,
    KeyDelivered,
    PeerFound,
    PeerLost,
    PeerSeen,
    RequestReceived,
    ResponseReceived,
    RoutingHandled,
    SampleReceived,
    StreamsDiffer,
    TransportEvent,
)
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.transport.actions.events import ActionEvent
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.run.dispatching import Dispatcher
from zacoustic.run.pending import CallEnd
from zacoustic.zenoh.gateway.events.eventnotices import TOLD, EventNotices
from zacoustic.zenoh.gateway.lostcontact import LostContactActions
from zacoustic.zenoh.gateway.network.network import LocalNetwork
from zacoustic.zenoh.gateway.status.documents.objects import Objects
from zacoustic.zenoh.gateway.status.status import Status
from zacoustic.zenoh.gateway.streams.handlers import StreamHandlers
from zacoustic.zenoh.requests.context import RequestContext

_HEARD_ELSEWHERE = (
    DeliveryStored,
    PeerMeasured,
    ModemRead,
    TransportEvent,
    CommandHandled,
    RoutingHandled,
    KeyDelivered,
)
"""Events for programs on a link and the audit log; the health report asks for measurements."""


class EventDispatcher(Dispatcher):
    """Hands on the events of a gateway; for the loop.

    Args:
        streams: Take samples, received calls and goals.
        context: Has the requests that wait for calls and ranges.
        objects: Take progress of objects.
        network: Sees engines restart, and peers go and come.
        status: Records the rest, and emits notices.
        notices: Makes the notices.
        lost_contact: Acts when contact is lost.
    """

    def __init__(
        self,
        streams: StreamHandlers,
        context: RequestContext,
        objects: Objects,
        network: LocalNetwork,
        status: Status,
        notices: EventNotices,
        lost_contact: LostContactActions,
    ) -> None:
        self._context = context
        self._status = status
        self._notices = notices
        super().__init__(
            {
                **dict.fromkeys(TOLD, (self._tell,)),
                **dict.fromkeys(get_args(ActionEvent), (streams.actions.deliver,)),
                **dict.fromkeys(_HEARD_ELSEWHERE, ()),
                SampleReceived: (streams.topics.deliver, status.note_sample),
                RequestReceived: (streams.services.deliver,),
                ResponseReceived: (self._answer,),
                CallFailed: (self._answer,),
                RangeMeasured: (self._take_range,),
                RangeFailed: (self._fail_range,),
                DeliveryEnded: (status.note_delivery,),
                ObjectProgress: (objects.note,),
                StreamsDiffer: (status.note_difference, self._tell),
                PeerSeen: (status.note_peer, self._tell),
                PeerLost: (self._tell, network.note_peer),
                PeerFound: (self._tell, network.note_peer),
                ContactLost: (lost_contact.lost,),
                ContactRestored: (lost_contact.restored,),
                EngineRestarted: (self._tell, network.go_on),
            }
        )

    def _answer(self, event: CallEnd) -> None:
        self._context.ends.take(event.call_id, event)

    def _take_range(self, event: RangeMeasured | RangeFailed) -> bool:
        return self._context.ranges.take(event.range_id, event)

    def _fail_range(self, event: RangeFailed) -> None:
        if not self._take_range(event):
            self._tell(event)

    def _tell(self, event: Event) -> None:
        notice = self._notices.of(event)
        if notice is not None:
            self._status.tell(notice)
