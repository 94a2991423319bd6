"""The commands of one node: those that it gives, and those that it executes."""

from collections.abc import Callable
from typing import Final, assert_never

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.qos import Priority
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.streams.commands import (
    ORDERS_STREAM_ID,
    SERIALS,
    Order,
    OrderKind,
    OrderState,
    check_timeout,
)
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.calls.answering import ANSWER_LANE
from zacoustic.core.transport.calls.calls import RequestReceived
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.transport.commands.ledger import Ledger, Standing
from zacoustic.core.transport.commands.tunings import Tunings
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.errors import LocalError

NOBODY: Final = 0
"""In place of an address: a command of the node's own network, or program."""


class StreamTuned(msgspec.Struct, frozen=True, kw_only=True):
    """A command has overridden how a topic of this node is sent, and the journal has it."""

    stream_id: int
    """The topic's stream."""
    on: bool
    """Its samples go; otherwise they wait, expire and are superseded."""
    min_interval_s: float
    """Minimum time between two transmitted samples of one key, s."""
    priority: Priority
    """Zenoh's priority."""
    ordered_by: int
    """Address of the commanding node; 0: commanded here."""
    changed_at: int
    """Instant, ns."""


class Orders:
    """What a node commands others to do, and does for them.

    Args:
        address: Address of the node.
        table: Its streams.
        services: They carry commands.
        handshake: Knows how long an answer may take.
        tunings: The overrides of topics.
        ledger: The executed commands.
        silence: The gate in front of all transmissions.
        obeys: Addresses of the nodes whose commands it executes; None: those of the table's list.
        emit: Takes `StreamTuned`.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        services: Services,
        handshake: Handshake,
        tunings: Tunings,
        ledger: Ledger,
        silence: Silence,
        obeys: frozenset[int] | None,
        emit: Callable[[StreamTuned], None],
    ) -> None:
        self.tunings = tunings
        """The overrides of topics; read only."""
        self._address = address
        self._table = table
        self._obeys = obeys
        self._services = services
        self._handshake = handshake
        self._silence = silence
        self._ledger = ledger
        self._emit = emit
        self._serial = 0
        stream = table.get(ORDERS_STREAM_ID)
        if stream is not None and stream.is_built_in:  # else the id is another service's
            self._services.serve_here(ORDERS_STREAM_ID, self._receive)

    def send(self, node: int, order: Order, now: int, *, timeout_s: float | None = None) -> int:
        """Give a command to another node; return the call id of its answer.

        The answer is a `ResponseReceived` of stream `ORDERS_STREAM_ID`, to be read by
        `OrderState.from_wire`, or a `CallFailed`: HANDLER when it is refused, with the reason.

        Args:
            node: Address of the node.
            order: The command.
            now: The instant.
            timeout_s: How long to try, s, at most 600; None: 600.

        Raises:
            LocalError: No such node, this one itself, a longer time, or the table has no remote
                commands.
            QueueFullError: Too many commands to that node are under way.
        """
        if not 1 <= node <= 254:
            raise LocalError(f"node {node}; allowed: 1..254")
        if timeout_s is not None:
            check_timeout(timeout_s)
        rival = self._table.get(ORDERS_STREAM_ID)
        if rival is None:
            raise LocalError(f"no orders cross a link with wire: {self._table.wire.value}")
        if not rival.is_built_in:
            raise LocalError(
                f"stream {ORDERS_STREAM_ID} is {rival.name}, so no orders cross the water",
                hint="give that stream another id",
            )
        if order.changes:
            self._serial = (self._serial + 1) % SERIALS
        return self._services.call(
            ORDERS_STREAM_ID, order.to_wire(self._serial), now, timeout_s=timeout_s, server=node
        )

    def obey(self, order: Order, now: int, then: Callable[[OrderState], None]) -> None:
        """Execute a local command.

        Args:
            order: The command.
            now: The instant.
            then: Takes what holds, when it is written down.

        Raises:
            LocalError: It speaks of a topic that this node does not publish.
        """

        def kept(at: int) -> None:
            self._tell(order, NOBODY, at)
            then(self.state(order, at))

        self._do(order, now, kept)

    def state(self, order: Order, now: int) -> OrderState:
        """Return the state of the objects of a command.

        Raises:
            LocalError: It speaks of a topic that this node does not publish.
        """
        silence = self._silence.state(now)
        state = OrderState(
            silent=silence.is_silent,
            ordered=silence.is_ordered,
            left_s=None if silence.ends_at is None else ns_to_seconds(silence.ends_at - now),
        )
        if order.stream_id is None:
            return state
        on, qos = self.tunings.effective(self.tunings.check(order.stream_id))
        return msgspec.structs.replace(
            state, on=on, min_interval_s=qos.min_interval_s, priority=qos.priority
        )

    # For the channel

    def _receive(self, request: RequestReceived, now: int) -> None:
        """Take a command of another node."""
        call, age_s = request.call, request.age_s or 0.0
        obeys = self._table.nodes if self._obeys is None else self._obeys
        if call.client not in obeys:
            self._refuse(call, f"node {self._address} takes no orders of node {call.client}", now)
            return
        try:
            serial, order = Order.from_wire(request.value)
            if order.for_s is not None:
                order = _for_the_rest(order, age_s)
            if order.changes:
                self._obey_once(call, serial, order, now)
            else:
                self._answer(call, order, now)
        except (ValueError, LocalError) as error:
            self._refuse(call, str(error), now)

    def _obey_once(self, call: CallKey, serial: int, order: Order, now: int) -> None:
        """Execute a command, unless it or a later one has been executed."""
        standing = self._ledger.standing(call.client, order.subject, call.epoch, serial)
        if standing is Standing.OVERTAKEN:
            raise LocalError("overtaken by a later order")
        if standing is Standing.SAME:
            self._answer(call, order, now)
            return
        begins_silence = order.kind is OrderKind.SILENCE and not self._silence.is_silent(now)
        self._do(order, now, lambda at: self._tell(order, call.client, at))

        def kept(at: int) -> None:
            self._answer(call, order, at)
            if begins_silence:
                lane = (ORDERS_STREAM_ID, ANSWER_LANE, call.client)
                self._silence.grant(lane, until=at + self._handshake.patience_ns)

        # Behind what it did, so that both are there when this is.
        self._ledger.enter(call.client, order.subject, call.epoch, serial, kept)

    def _answer(self, call: CallKey, order: Order, now: int) -> None:
        self._services.reply(call, self.state(order, now).to_wire(), now)

    def _refuse(self, call: CallKey, reason: str, now: int) -> None:
        self._services.reply_error(call, CallFailure.HANDLER, reason, now)

    # Below the methods above

    def _do(self, order: Order, now: int, then: Callable[[int], None]) -> None:
        match order.kind:
            case OrderKind.ASK:
                self.state(order, now)  # raises here what it would raise later
                then(now)
            case OrderKind.SILENCE:
                self._silence.begin(now, duration_s=order.for_s, then=then)
            case OrderKind.RESUME:
                self._silence.resume(now, then=then)
            case OrderKind.TUNE | OrderKind.RESET:
                self.tunings.change(order, then)
            case _:
                assert_never(order.kind)

    def _tell(self, order: Order, by: int, now: int) -> None:
        """Report a changed topic to the application; `Silence` reports itself."""
        if order.kind not in (OrderKind.TUNE, OrderKind.RESET):
            return
        assert order.stream_id is not None
        on, qos = self.tunings.effective(self._table.by_id(order.stream_id))
        self._emit(
            StreamTuned(
                stream_id=order.stream_id,
                on=on,
                min_interval_s=qos.min_interval_s,
                priority=qos.priority,
                ordered_by=by,
                changed_at=now,
            )
        )


def _for_the_rest(order: Order, age_s: float) -> Order:
    """Return a silence that ends on time, however long the command took.

    Raises:
        LocalError: That is over.
    """
    assert order.for_s is not None
    try:
        return Order(kind=order.kind, for_s=order.for_s - age_s)
    except ValueError:
        raise LocalError("it came when its time was over") from None
