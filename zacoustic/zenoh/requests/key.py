"""The delivery of a key: ``@acoustic/3/key?source=5;within_s=120``.

The local gateway sends node 3 the key for the broadcasts of node 5
(`zacoustic.core.transport.keydelivery`). No key is in query or answer.
"""

from typing import TYPE_CHECKING, Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.streams.keydelivery import KEYS_TIMEOUT_S, WRAPPED_BYTES
from zacoustic.core.wire.seal import LONG_HEAD_BYTES, STRONG_TAG_BYTES
from zacoustic.text.digits import whole_number
from zacoustic.zenoh.requests.context import Asking
from zacoustic.zenoh.requests.request import Parameter, Request

if TYPE_CHECKING:
    from zacoustic.core.engine.engine import Engine

_FRAME_BYTES: Final = 5 + WRAPPED_BYTES + LONG_HEAD_BYTES + STRONG_TAG_BYTES
"""Bytes of a frame with a key: 5 are stream id, server, call, source, and end of the record."""


class KeyAsked(msgspec.Struct, frozen=True, kw_only=True):
    """A delivery."""

    source: int
    """The node whose broadcasts the key opens, 1…254."""


class KeyAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a delivery."""

    address: int
    """The node that has the key now."""
    source: int
    """The node whose broadcasts it opens."""
    by: int
    """The node that has sent it."""
    airtime_s: float
    """Airtime of one frame with the key, s."""

    def text(self) -> str:
        """Return it in words."""
        return (
            f"node {self.address} opens broadcasts of node {self.source} now: sent by node "
            f"{self.by}, a frame of {self.airtime_s:g} s"
        )


def _send(asking: Asking[KeyAsked, KeyAnswer], engine: "Engine", now: int) -> None:
    node, source = asking.node, asking.question.source
    call_id = engine.keys.send(node, source, now, timeout_s=asking.within_s)
    capabilities = engine.capabilities
    airtime_ns = 0 if capabilities is None else capabilities.airtime_ns(_FRAME_BYTES)
    airtime_s = round(ns_to_seconds(airtime_ns), 2)
    answer = KeyAnswer(address=node, source=source, by=engine.address, airtime_s=airtime_s)
    asking.wait(call_id, lambda end: answer, maybe="may have the key")


def _address(text: str) -> int | None:
    number = whole_number(text)
    return number if number is not None and 1 <= number <= 254 else None


KEY: Final = Request(
    subject="key",
    parameters={"source": Parameter(_address, "1..254", is_required=True)},
    make=KeyAsked,
    answer=KeyAnswer,
    begin=_send,
    within_s=120.0,
    most_s=KEYS_TIMEOUT_S,
    not_here="copy the list to it",
)
"""Sends a remote node a key for broadcasts."""
