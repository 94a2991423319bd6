"""Delivers the key for a source's broadcasts to one node, on command.

The application gives the command at a node that can open these broadcasts (the source itself, or
one whose list has the key). The cipher wraps the key for the receiving node, so no key byte is in
an engine, a recording or a log. The receiving node takes it only from the nodes whose commands it
executes; its cipher unwraps and stores it. The call is a service of its own, `KEYS_STREAM_ID`,
whose frames are as strong as commands.
"""

from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.schedule.context import NodeContext
from zacoustic.core.streams.keydelivery import (
    KEYS_STREAM_ID,
    KEYS_TIMEOUT_S,
    decode_delivery,
    encode_delivery,
)
from zacoustic.core.transport.calls.calls import RequestReceived
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.wire.calls import CallFailure
from zacoustic.errors import LocalError

_NO_SEAL: Final = "this node has no identity: it has one key for all nodes, or none"


class KeyDelivered(msgspec.Struct, frozen=True, kw_only=True):
    """Another node has delivered the key for a source's broadcasts, or tried to."""

    source: int
    """The source; 0: unknown."""
    delivered_by: int
    """Address of the node that sent the key."""
    refusal: str
    """Why the key was refused, one line; empty: it is stored."""
    handled_at: int
    """Instant, ns."""


class KeyDelivery:
    """Sends keys for broadcasts, and takes them.

    Args:
        node: The components that all links of the node share.
        services: Carry the calls; None: the wire carries none.
        executes: Addresses of the nodes from which it takes keys; None: all nodes of the table.
    """

    def __init__(
        self, node: NodeContext, services: Services | None, executes: frozenset[int] | None
    ) -> None:
        self._address = node.address
        self._table = node.table
        self._executes = executes
        self._services = services
        self._seal = node.seal
        self._alarms = node.alarms if node.seal is not None else None
        self._emit: Callable[[KeyDelivered], None] = node.emit
        stream = node.table.get(KEYS_STREAM_ID)
        self._is_carried = services is not None and stream is not None and stream.is_built_in
        if services is not None and self._is_carried:
            services.serve_here(KEYS_STREAM_ID, self._receive)

    def send(self, node: int, source: int, now: int, *, timeout_s: float = KEYS_TIMEOUT_S) -> int:
        """Send the key for a source's broadcasts to a node; return the call id of its answer.

        The answer is an empty `ResponseReceived`, or a `CallFailed`: HANDLER with the reason when
        the node refuses the key.

        Args:
            node: Address of the receiving node, 1…254.
            source: The node whose broadcasts it is to open, 1…254; it may be this one.
            now: The instant.
            timeout_s: How long to try, s, at most 600.

        Raises:
            LocalError: This node cannot open these broadcasts, has no identity, or knows no such
                node; or no service crosses the channel.
            QueueFullError: Too many calls to that node are under way.
        """
        if not 1 <= node <= 254 or node in (self._address, source):
            raise LocalError(f"node {node}; allowed: another one than this and than node {source}")
        if not 0 < timeout_s <= KEYS_TIMEOUT_S:
            raise LocalError(f"timeout_s is {timeout_s:g}; allowed: at most {KEYS_TIMEOUT_S:g}")
        if self._services is None or not self._is_carried:
            raise LocalError(
                f"no keys cross the channel: wire {self._table.wire.value} has no services, or the "
                f"table gives their id, {KEYS_STREAM_ID}, to another stream"
            )
        if self._seal is None:
            raise LocalError(_NO_SEAL)
        request = encode_delivery(source, self._seal.wrap_key(source, node))
        return self._services.call(KEYS_STREAM_ID, request, now, timeout_s=timeout_s, server=node)

    # For the channel

    def _receive(self, request: RequestReceived, now: int) -> None:
        call, source, refusal = request.call, 0, ""
        assert self._services is not None
        executes = self._table.nodes if self._executes is None else self._executes
        if call.client not in executes:
            if self._alarms is not None:
                self._alarms.forbidden(call.client, KEYS_STREAM_ID, now)
            refusal = f"node {self._address} takes no keys from node {call.client}"
        elif self._seal is None:
            refusal = _NO_SEAL
        else:
            try:
                source, wrapped = decode_delivery(request.value)
                self._seal.take_key(source, call.client, wrapped)
            except (ValueError, LocalError) as error:
                refusal = str(error)
        if refusal:
            self._services.reply_error(call, CallFailure.HANDLER, refusal, now)
        else:
            self._services.reply(call, b"", now)
        self._emit(
            KeyDelivered(source=source, delivered_by=call.client, refusal=refusal, handled_at=now)
        )
