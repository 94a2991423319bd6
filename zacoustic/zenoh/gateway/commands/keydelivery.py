"""Deliveries of keys that the local network asks for; the gateway sends them."""

from functools import partial

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure
from zacoustic.core.streams.keydelivery import WRAPPED_BYTES
from zacoustic.core.values.encoding import JSON
from zacoustic.core.wire.seal import LONG_HEAD_BYTES, STRONG_TAG_BYTES
from zacoustic.errors import LocalError
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.commands.refusing import refuse_failed
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.session.asking.commands import node_in
from zacoustic.zenoh.session.asking.keydelivery import (
    DELIVERIES,
    KeyAnswer,
    KeyAsked,
    read_delivery,
)
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery

_RECORD_BYTES = 5 + WRAPPED_BYTES
"""Stream id, server, call, source and wrapped secret, with the end of the record."""


class KeyHandler:
    """Takes deliveries of the local network; for the loop.

    Args:
        runner: Runs the engine that sends the keys.
        redundant: The local gateways.
        ends: The calls of the gateway.
    """

    def __init__(
        self, runner: LinkRunner, redundant: RedundantGateways, ends: Pending[CallEnd]
    ) -> None:
        self._runner = runner
        self._redundant = redundant
        self._ends = ends

    @property
    def key(self) -> str:
        """Key expression of deliveries."""
        return DELIVERIES

    def serve(self, held: HeldQuery) -> None:
        """Take a query."""
        node = node_in(held.key, "key")
        if node is None or not self._redundant.asks(node, self._runner.engine.table.nodes):
            held.answer([])
            return
        try:
            asked = read_delivery(held.key, held.parameters)
            assert asked is not None
            if asked.node in self._redundant.alive:
                raise ValueError(f"node {node} is on this local network: copy the list to it")
            self._runner.apply(partial(self._send, held, asked))
        except (ValueError, LocalError) as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))

    # Below the methods above

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
        self._ends.add(call_id, partial(_answer, held, answer))


def _answer(held: HeldQuery, answer: KeyAnswer, end: CallEnd) -> None:
    """Answer when the node has the key."""
    if isinstance(end, CallFailed):
        refuse_failed(held, end, answer.address, maybe="may have the key")
    else:
        held.answer([Answer(key=held.key, payload=msgspec.json.encode(answer), encoding=JSON)])
