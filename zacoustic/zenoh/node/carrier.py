"""`Carrier`: a link or a Zenoh session, which carries the values of endpoints.

Endpoints know only a `Carrier`, so they behave alike on both. Values cross this contract as dicts
and bytes, as in the codecs; only endpoints know classes. All calls are on the loop, unless a
docstring says otherwise, and no callback given to a carrier may raise.
"""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import msgspec

from zacoustic.core.base.linktypes import LinkMetrics, ModemRead, PeerMeasured
from zacoustic.core.base.stats import EngineStats, LedgerEntry
from zacoustic.core.engine.events import (
    AccessStateChanged,
    AddressShared,
    BulkChanged,
    ClockStateChanged,
    ContactLost,
    ContactRestored,
    CustodyChanged,
    DeadlineMissed,
    DeliveryEnded,
    EngineRestarted,
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
from zacoustic.core.peers.measurements import Range
from zacoustic.core.peers.ranging import RangeFailed, RangeFailure
from zacoustic.core.profiles.entities import RosEntitySeen
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import (
    CallTimeoutError,
    RangeUnavailableError,
    ZacousticError,
)
from zacoustic.zenoh.ends.calls import TakeCall
from zacoustic.zenoh.ends.goals import GoalHandler
from zacoustic.zenoh.node.delivery import Delivery
from zacoustic.zenoh.node.goals import SentGoals
from zacoustic.zenoh.node.routes import ActionRoute, ServiceRoute, TopicRoute
from zacoustic.zenoh.requests.request import Request

Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)

NodeEvent = (
    LinkStateChanged
    | JournalStateChanged
    | JournalDoubted
    | AddressShared
    | SealAlarm
    | ClockStateChanged
    | AccessStateChanged
    | NothingHeard
    | BulkChanged
    | EngineRestarted
    | PeerSeen
    | PeerLost
    | PeerFound
    | PeerReachable
    | ContactLost
    | ContactRestored
    | SubscribersChanged
    | DeadlineMissed
    | StreamsDiffer
    | PeerMeasured
    | ModemRead
    | DeliveryEnded
    | CustodyChanged
    | SilenceChanged
    | StreamOverridden
    | ObjectProgress
    | RosEntitySeen
)
"""Events of a node other than samples and calls; on Zenoh only the first kind."""


class Incoming(msgspec.Struct, frozen=True, kw_only=True):
    """A received sample."""

    key: str
    """The key of the sample."""
    value: Any
    """The value, a dict or bytes; None for a delete."""
    source: int | None
    """Acoustic address of the source; None: it was published locally."""
    deleted: bool
    """The key was deleted."""
    encoding: str
    """Encoding that the publisher used."""
    age_s: float | None
    """Age at `received_at`, s; None: unknown."""
    age_error_s: float | None = None
    """How wrong that may be, s; None: nothing bounds it."""
    received_at: int
    """Instant of arrival, ns."""
    metrics: LinkMetrics
    """The modem's measurements of the frame."""


class Outlet(msgspec.Struct, frozen=True):
    """Takes the samples of one publisher."""

    put: Callable[[object, str | None, bool], Delivery | None]
    """Sends a value in an encoding, or tells that the key is deleted, and returns at once; any
    thread may call it. Returns the delivery, on a reliable topic, if the carrier learns the
    outcome. Raises `LocalError`: the value cannot be sent, or a bounded queue is full."""
    close: Callable[[], None]
    """Closes the outlet; may be called again."""


class Carrier(Protocol):
    """A link with its engine, or a Zenoh session."""

    @property
    def stats(self) -> EngineStats:
        """The counters."""
        ...

    @property
    def can_declare(self) -> bool:
        """Whether code can add streams."""
        ...

    def declare(self, spec: StreamSpec) -> Stream:
        """Add a stream; only if `can_declare`."""
        ...

    def expired(self) -> dict[int, int]:
        """Return how many samples and calls expired before their transmission, by stream id."""
        ...

    def ledger(self) -> list[LedgerEntry]:
        """Return the bytes given to the link, by stream and cause."""
        ...

    @property
    def sent_goals(self) -> SentGoals:
        """The goals that this node has sent."""
        ...

    def serve_goals(
        self, route: ActionRoute[Any, Any, Any], handler: GoalHandler
    ) -> Callable[[], None]:
        """Pass on the goals of an action; return the function that ends it.

        Raises:
            LocalError: This node already serves the action.
        """
        ...

    async def open(self) -> None:
        """Open.

        Raises:
            ZacousticError: It cannot be opened; nothing stays open.
        """
        ...

    async def close(self) -> None:
        """Close, and fail the calls under way."""
        ...

    async def flush(self) -> None:
        """Wait until all published samples have left this process."""
        ...

    async def range(self, address: int, timeout_s: float) -> Range:
        """Measure the range of another node; cancelling gives up.

        Raises:
            LocalError: There is no such node, it is this one, or the time limit is not valid.
            RangeUnavailableError: No range can be measured from here.
            CallTimeoutError: No range was measured in time.
        """
        ...

    async def ask(self, request: Request[Q, A], node: int, question: Q, within_s: float) -> A:
        """Make a request about a node; cancelling gives up.

        Raises:
            LocalError: There is no such node, or the request makes no sense here.
            ServiceError: The node refuses it.
            CallTimeoutError: No answer came in time.
            DeliveryError: The request cannot be sent from here.
        """
        ...

    def refuse(self, source: int, transfer: int) -> bool:
        """Refuse the rest of an incoming large sample.

        Returns:
            Whether the sample was still under way.
        """
        ...

    def advertise(self, route: TopicRoute[Any]) -> Outlet:
        """Create the outlet of a publisher."""
        ...

    def subscribe(
        self, route: TopicRoute[Any], deliver: Callable[[Incoming], None]
    ) -> Callable[[], None]:
        """Deliver arriving samples; return the function that ends it."""
        ...

    async def call(
        self, route: ServiceRoute[Any, Any], value: object, timeout_s: float | None
    ) -> object:
        """Call a service.

        Raises:
            LocalError: The request cannot be sent.
            DeliveryError, ServiceError: There is no response; see `call_error`.
        """
        ...

    def serve(self, route: ServiceRoute[Any, Any], take: TakeCall) -> Callable[[], None]:
        """Pass on the calls of a service; return the function that ends it."""
        ...


def range_error(event: RangeFailed) -> ZacousticError:
    """Return the exception for a range that cannot be measured in time or at all.

    Returns:
        `CallTimeoutError` if no range was measured in time, `RangeUnavailableError` if none can be.
    """
    text = f"range to node {event.address}: {event.failure.name}: {event.text}"
    if event.failure is RangeFailure.TIMED_OUT:
        return CallTimeoutError(text)
    return RangeUnavailableError(text)
