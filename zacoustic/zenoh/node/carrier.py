"""What carries the endpoints of a node: a link, or a Zenoh session.

Endpoints know a `Carrier` and no more, so they behave alike on both. Values cross this contract as
codecs have them, dicts and bytes; classes are the endpoints' affair. Everything is called on the
loop, except where it says otherwise, and no callback given to a carrier may raise.
"""

from collections.abc import Callable
from typing import Any, Final, Protocol

import msgspec

from zacoustic.core.base.linktypes import LinkMetrics, ModemRead, PeerMeasured
from zacoustic.core.base.stats import EngineStats, LedgerEntry
from zacoustic.core.engine.events import (
    CallFailure,
    ClockStateChanged,
    DeadlineMissed,
    DeliveryEnded,
    EngineRestarted,
    JournalDoubted,
    JournalStateChanged,
    LinkStateChanged,
    NothingHeard,
    PeerFound,
    PeerLost,
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
from zacoustic.core.streams.commands import CommandState, RemoteCommand
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import (
    CallTimeoutError,
    DeliveryError,
    OutcomeUnknownError,
    RangeUnavailableError,
    ServiceError,
    ZacousticError,
)
from zacoustic.zenoh.node.delivery import Delivery
from zacoustic.zenoh.node.goals import GoalCarrier
from zacoustic.zenoh.node.routes import ServiceRoute, TopicRoute

NodeEvent = (
    LinkStateChanged
    | JournalStateChanged
    | JournalDoubted
    | SealAlarm
    | ClockStateChanged
    | NothingHeard
    | EngineRestarted
    | PeerSeen
    | PeerLost
    | PeerFound
    | SubscribersChanged
    | DeadlineMissed
    | StreamsDiffer
    | PeerMeasured
    | ModemRead
    | DeliveryEnded
    | SilenceChanged
    | StreamOverridden
    | ObjectProgress
    | RosEntitySeen
)
"""Events of a node besides samples and calls; on Zenoh the first kind only."""

CLOSED_TEXT: Final = "the service was closed"
"""What a caller reads whose call was under way then."""


class Incoming(msgspec.Struct, frozen=True, kw_only=True):
    """A sample as it arrived."""

    key: str
    """The key that it was published under."""
    value: Any
    """A dict or bytes; None for a delete."""
    source: int | None
    """Acoustic address of its source; None: it was published locally."""
    deleted: bool
    """The key was deleted."""
    encoding: str
    """Encoding that the publisher used."""
    age_s: float | None
    """How old it was when its frame was composed, s."""
    received_at: int
    """Instant of its arrival, ns."""
    metrics: LinkMetrics
    """What the modem measured."""


class IncomingCall(Protocol):
    """A call to answer once."""

    value: Any
    """The request, a dict or bytes."""
    client: int | None
    """Acoustic address of the caller; None: it is local."""
    call_id: str | None
    """Call id; None: the caller is local."""
    deadline_at: int
    """Instant after which an answer is worthless, ns."""

    def reply(self, value: object) -> bool:
        """Answer; False when it is too late or answered already.

        Raises:
            LocalError: The response cannot be sent; the caller knows it.
        """
        ...

    def fail(self, failure: CallFailure, text: str) -> bool:
        """Answer with an error; False when it is too late or answered already."""
        ...


class Outlet(Protocol):
    """Where one publisher puts its samples."""

    def put(self, value: object, encoding: str | None) -> Delivery | None:
        """Send a value; returns at once; may be called from any thread.

        Returns:
            Its delivery, on a reliable topic, if the carrier learns the outcome.

        Raises:
            LocalError: The value cannot be sent, or a bounded queue is full.
        """
        ...

    def delete(self) -> Delivery | None:
        """Say that the key is deleted; as `put`."""
        ...

    def close(self) -> None:
        """Withdraw. May be called again."""
        ...


class Carrier(Protocol):
    """A link with its engine, or a Zenoh session."""

    @property
    def stats(self) -> EngineStats:
        """What was counted."""
        ...

    @property
    def can_declare(self) -> bool:
        """Streams can be added from code."""
        ...

    def declare(self, spec: StreamSpec) -> Stream:
        """Add a stream; only where `can_declare`."""
        ...

    def expired(self) -> dict[int, int]:
        """Samples and calls that became too old before they could be sent, by stream id."""
        ...

    def ledger(self) -> list[LedgerEntry]:
        """Bytes given to the link, by stream and cause."""
        ...

    @property
    def goals(self) -> GoalCarrier:
        """What carries the goals of actions."""
        ...

    async def open(self) -> None:
        """Begin.

        Raises:
            ZacousticError: It cannot be opened; nothing is left behind.
        """
        ...

    async def close(self) -> None:
        """End; fails the calls that are under way."""
        ...

    async def flush(self) -> None:
        """Wait until everything that was published has left this process."""
        ...

    async def range(self, address: int, timeout_s: float) -> Range:
        """Measure the range of another node; cancelling gives it up.

        Raises:
            LocalError: No such node, this one itself, or a time that is none.
            RangeUnavailableError: No range can be measured from here.
            CallTimeoutError: None was measured in time.
        """
        ...

    async def command(self, node: int, command: RemoteCommand, timeout_s: float) -> CommandState:
        """Give a command to a node; cancelling gives it up.

        Raises:
            LocalError: No such node, or the command makes no sense here.
            ServiceError: The node refuses it.
            CallTimeoutError: No answer in time.
            DeliveryError: It cannot be given from here.
        """
        ...

    def refuse(self, source: int, transfer: int) -> bool:
        """Refuse the rest of a large sample that is on its way to here.

        Returns:
            Whether it was still on its way.
        """
        ...

    def advertise(self, route: TopicRoute[Any]) -> Outlet:
        """Make the way out of a publisher."""
        ...

    def subscribe(
        self, route: TopicRoute[Any], deliver: Callable[[Incoming], None]
    ) -> Callable[[], None]:
        """Deliver what arrives; returns what ends it."""
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

    def serve(
        self, route: ServiceRoute[Any, Any], handle: Callable[[IncomingCall], None]
    ) -> Callable[[], None]:
        """Hand over the calls of a service; returns what ends it."""
        ...


_HINTS: Final = {
    CallFailure.NO_SERVER: "start the program that serves it",
    CallFailure.TABLE_MISMATCH: "compare both configs: zacoustic check FILE",
    CallFailure.TIMED_OUT: "whether the service ran is unknown",
    CallFailure.UNKNOWN: "whether it has done its work is unknown",
}

_KINDS: Final = {
    CallFailure.TIMED_OUT: CallTimeoutError,
    CallFailure.UNKNOWN: OutcomeUnknownError,
}
_REASONS: Final = {CallFailure.UNKNOWN: "the server ended without an answer"}


def call_error(name: str, failure: CallFailure, text: str) -> ZacousticError:
    """Make the exception of a call without a response.

    Returns:
        `ServiceError` when the handler failed, with its own text; `CallTimeoutError` when nothing
        came in time; `OutcomeUnknownError` when the server ended without one; `DeliveryError` for
        everything between them.
    """
    if failure is CallFailure.HANDLER:
        return ServiceError(text or "the handler failed without a word")
    kind = _KINDS.get(failure, DeliveryError)
    reason = text or _REASONS.get(failure) or failure.name.lower().replace("_", " ")
    return kind(f"{name}: {reason}", hint=_HINTS.get(failure, ""))


def range_error(event: RangeFailed) -> ZacousticError:
    """Make the exception of a range that will not come.

    Returns:
        `CallTimeoutError` when none was measured in time, `RangeUnavailableError` when none can be.
    """
    text = f"range to node {event.address}: {event.failure.name}: {event.text}"
    if event.failure is RangeFailure.TIMED_OUT:
        return CallTimeoutError(text)
    return RangeUnavailableError(text)
