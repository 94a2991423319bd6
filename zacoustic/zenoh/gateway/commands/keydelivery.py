"""Deliveries of keys that the local network asks for; the gateway sends them."""

from collections.abc import Iterable
from functools import partial
from typing import cast

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.streams.keydelivery import WRAPPED_BYTES
from zacoustic.core.values.encoding import JSON
from zacoustic.core.wire.seal import LONG_HEAD_BYTES, STRONG_TAG_BYTES
from zacoustic.errors import LocalError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.session.asking.keydelivery import (
    DELIVERIES,
    KeyAnswer,
    KeyAsked,
    read_delivery,
    receiving_node,
)
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery

_RECORD_BYTES = 5 + WRAPPED_BYTES
"""Stream id, server, call, source and wrapped secret, with the end of the record."""


class KeyHandler:
    """Takes deliveries of the local network; for the loop.

    Args:
        runner: Runs the engine that sends the keys.
        redundant: The local gateways.
    """

    def __init__(self, runner: LinkRunner, redundant: RedundantGateways) -> None:
        self._runner = runner
        self._redundant = redundant
        self._sent: dict[int, tuple[HeldQuery, KeyAnswer]] = {}

    @property
    def key(self) -> str:
        """Key expression of deliveries."""
        return DELIVERIES

    def serve(self, held: HeldQuery) -> None:
        """Take a query."""
        # Zenoh's stubs do not declare that parameters can be iterated over.
        parameters = cast("Iterable[tuple[str, str]]", held.query.parameters)
        key = str(held.query.key_expr)
        node = receiving_node(key)
        if node is None or not self._is_ours(node):
            held.answer([])
            return
        try:
            asked = read_delivery(key, dict(parameters))
            assert asked is not None
            if asked.node in self._redundant.alive:
                raise ValueError(f"node {node} is on this local network: copy the list to it")
            self._runner.apply(partial(self._send, held, asked))
        except (ValueError, LocalError) as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))

    def answered(self, event: ResponseReceived | CallFailed) -> bool:
        """Take the answer of a node, or its absence; False: it belongs to no delivery."""
        sent = self._sent.pop(event.call_id, None)
        if sent is None:
            return False
        held, answer = sent
        if isinstance(event, ResponseReceived):
            key = str(held.query.key_expr)
            held.answer([Answer(key=key, payload=msgspec.json.encode(answer), encoding=JSON)])
            return True
        text = event.text
        if event.failure is CallFailure.TIMED_OUT:
            text = f"node {answer.address} has not answered in time, and may have the key"
        held.refuse(event.failure, text)
        return True

    # Below the methods above

    def _is_ours(self, node: int) -> bool:
        """Return whether this one of the local gateways sends the key."""
        nodes = self._runner.engine.table.nodes
        is_known = 1 <= node <= 254 and (not nodes or node in nodes)
        return is_known and self._redundant.address == self._redundant.alive[0]

    def _send(self, held: HeldQuery, asked: KeyAsked, engine: Engine, now: int) -> None:
        call_id = engine.keys.send(asked.node, asked.source, now, timeout_s=asked.within_s)
        capabilities = engine.capabilities
        frame_bytes = _RECORD_BYTES + LONG_HEAD_BYTES + STRONG_TAG_BYTES
        airtime_ns = 0 if capabilities is None else capabilities.airtime_ns(frame_bytes)
        answer = KeyAnswer(
            address=asked.node,
            source=asked.source,
            by=engine.address,
            airtime_s=round(ns_to_seconds(airtime_ns), 2),
        )
        self._sent[call_id] = held, answer
