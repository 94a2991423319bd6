"""The status of this node for others, and questions about theirs.

Before a dive somebody wants to know of a node that is out of reach whether its journal is there,
whether its clock is right, and whether its slots are those of the others. Only the node itself
knows. It is a service of its own, `STATUS_STREAM_ID`, which every table has and every node serves:
so it works between tables that differ, and where frames are sealed its frames are strong. A
question changes nothing; only nodes of the list are answered.
"""

import hashlib

import msgspec

from zacoustic.core.base.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.base.journal import LIFE_KEY, VOLATILE_KEY
from zacoustic.core.schedule.access.spec import (
    AccessSpec,
    AutoSpec,
    PollingSpec,
    ScheduleSpec,
    TdmaSpec,
)
from zacoustic.core.schedule.context import NodeContext
from zacoustic.core.schedule.hosttime import HostTime
from zacoustic.core.streams.status import STATUS_STREAM_ID, JournalStatus, NodeStatus
from zacoustic.core.transport.calls.calls import RequestReceived
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.wire.calls import CallFailure
from zacoustic.errors import LocalError


class Status:
    """Asks for the status of others, and tells that of this node.

    Args:
        node: The components that all links of the node share.
        services: Carry questions and answers; None: the wire carries none.
        clock: What is known of UTC.
        access: The settings of medium access.
    """

    def __init__(
        self,
        node: NodeContext,
        services: Services | None,
        clock: HostTime,
        access: AccessSpec | None,
    ) -> None:
        self._address = node.address
        self._table = node.table
        self._stored = node.stored
        self._journal = node.journal
        self._doubt = node.doubt
        self._measurements = node.measurements
        self._services = services
        self._clock = clock
        self._schedule = schedule_digest(access)
        if services is not None and self.is_carried:
            services.serve_here(STATUS_STREAM_ID, self._receive)

    @property
    def is_carried(self) -> bool:
        """The wire carries it, and the table has not given its id to another stream."""
        stream = self._table.get(STATUS_STREAM_ID)
        return self._services is not None and stream is not None and stream.is_built_in

    def ask(self, node: int, now: int, *, timeout_s: float) -> int:
        """Ask a node; return the call id of its answer, a `ResponseReceived` or `CallFailed`.

        `NodeStatus.from_wire` reads the response.

        Raises:
            LocalError: No such node, or this one; or it `is_carried` not.
            QueueFullError: Too many questions to that node are under way.
        """
        if not 1 <= node <= 254:
            raise LocalError(f"node {node}; allowed: 1..254")
        if self._services is None or not self.is_carried:
            raise LocalError(
                f"no status crosses the channel: wire {self._table.wire.value} has none, or the "
                f"table gives its id, {STATUS_STREAM_ID}, to another stream"
            )
        return self._services.call(STATUS_STREAM_ID, b"", now, timeout_s=timeout_s, server=node)

    def own(self, now: int, asker: int = 0) -> NodeStatus:
        """Return the status of this node.

        Args:
            now: The instant, ns.
            asker: The node whose range is wanted; 0: none.
        """
        shown_ns, error_ns = self._clock.shown_ns, self._clock.shown_error_ns
        measured = self._measurements.range(asker) if asker else None
        range_m = None if measured is None else measured.range_m
        return NodeStatus(
            journal=self._journal_status(),
            starts=int.from_bytes(self._stored.get(LIFE_KEY, b""), "big"),
            utc_s=None if shown_ns is None else round((now + shown_ns) / NS_PER_S),
            clock_error_s=None if error_ns is None else ns_to_seconds(error_ns),
            range_m=None if range_m is None else round(range_m),
            schedule=self._schedule,
        )

    # For the channel

    def _receive(self, request: RequestReceived, now: int) -> None:
        call = request.call
        assert self._services is not None
        if call.client not in self._table.nodes:
            self._services.reply_error(call, CallFailure.HANDLER, "not in the list", now)
            return
        self._services.reply(call, self.own(now, call.client).to_wire(), now)

    # Below the methods above

    def _journal_status(self) -> JournalStatus:
        if LIFE_KEY not in self._stored or VOLATILE_KEY in self._stored:
            return JournalStatus.NONE
        if self._journal.failure:
            return JournalStatus.FAILING
        return JournalStatus.DOUBTED if self._doubt.reason else JournalStatus.KEPT


def schedule_digest(access: AccessSpec | None) -> int:
    """Return a number, 1…65535, that differs where slots or turns differ; 0: there are none."""
    match access:
        case TdmaSpec():
            shared: tuple[object, ...] = (
                access.slots, access.slot_s, access.max_range_m, access.guard_s, access.clock
            )  # fmt: skip
        case AutoSpec():
            return schedule_digest(access.schedule)
        case ScheduleSpec():
            shared = (access.slots, access.clock)
        case PollingSpec():
            shared = (access.poller, access.nodes, access.turn_s, access.max_range_m)
        case _:
            return 0
    found = hashlib.sha256(msgspec.json.encode((type(access).__name__, *shared))).digest()
    return int.from_bytes(found[:2], "big") or 1
