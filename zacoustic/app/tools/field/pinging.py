"""Pings of the command line: one after the other, through a gateway or on a link, and statistics.

Over an acoustic channel a round trip takes seconds, so the next ping goes when the last one was
answered or given up, and the interval is over. `zacoustic.zenoh.requests.ping` describes the
parts of a ping.
"""

import asyncio
import contextlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Sequence

import msgspec
import zenoh

from zacoustic.app.tools.field.asking import Gateways
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.errors import (
    CallTimeoutError,
    DeliveryError,
    LocalError,
    RangeUnavailableError,
    ServiceError,
)
from zacoustic.zenoh.node import Node
from zacoustic.zenoh.requests.ping import LINK_DOWN, PING, RANGE_LIMIT_S, PingAnswer, PingAsked


class Ping(msgspec.Struct, frozen=True, kw_only=True):
    """One ping."""

    number: int
    """Number, from 1."""
    answer: PingAnswer | None
    """Its answer; None: none came in time."""
    unix_s: float
    """Time of its end, s since 1970."""
    why: str = ""
    """Why there is no answer, if more is known than that none came in time."""


class Pinger(ABC):
    """Sends pings."""

    @abstractmethod
    async def ping(self, node: int, timeout_s: float) -> PingAnswer:
        """Ping a node once.

        Raises:
            CallTimeoutError: No answer in time.
            DeliveryError, LocalError: The node cannot be asked.
        """


class GatewayPinger(Pinger):
    """Pings through the local gateway.

    Args:
        gateways: The gateways on its network.
    """

    def __init__(self, gateways: Gateways) -> None:
        self._gateways = gateways

    async def ping(self, node: int, timeout_s: float) -> PingAnswer:
        """Ask the local gateways; the responsible one pings."""
        return await self._gateways.ask(PING, node, PingAsked(), timeout_s)


class LinkPinger(Pinger):
    """Pings on its own link.

    Args:
        node: A node in direct mode, open.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    async def ping(self, node: int, timeout_s: float) -> PingAnswer:
        """Ask the node for its state, then its modem for the range."""
        assert self._node.address is not None
        if node == self._node.address:
            raise DeliveryError(f"node {node} is this node")
        began_s = time.monotonic()
        answer = PingAnswer(address=node, by=self._node.address)
        left_s = timeout_s
        try:
            with contextlib.suppress(ServiceError):  # a refusal is an answer
                await self._node.command(node, RemoteCommand(), timeout_s=timeout_s)
            round_trip_s = time.monotonic() - began_s
            answer = msgspec.structs.replace(answer, round_trip_s=round_trip_s)
            left_s = max(min(timeout_s - round_trip_s, RANGE_LIMIT_S), 0.001)
        except LocalError:
            pass  # no remote commands on this wire: only the range is measured
        try:
            found = await self._node.range(node, timeout_s=left_s)
        except (CallTimeoutError, RangeUnavailableError):
            if answer.round_trip_s is None:
                raise
            return answer
        return msgspec.structs.replace(
            answer,
            propagation_s=found.propagation_s,
            range_m=found.range_m,
            range_age_s=round(found.age_s(time.monotonic_ns()), 3),
            integrity=found.integrity,
        )


async def pings(
    pinger: Pinger, node: int, *, count: int, interval_s: float, timeout_s: float
) -> AsyncIterator[Ping]:
    """Ping a node several times, one after the other.

    Args:
        pinger: Sends the pings.
        node: Its address.
        count: Number of pings.
        interval_s: Least period, s.
        timeout_s: Time limit of an answer, s.

    Raises:
        DeliveryError, LocalError: The node cannot be asked.
    """
    loop = asyncio.get_running_loop()
    for number in range(1, count + 1):
        due_at = loop.time() + interval_s
        answer, why = None, ""
        try:
            answer = await pinger.ping(node, timeout_s)
        except CallTimeoutError as error:
            why = str(error) if LINK_DOWN in str(error) else ""
        except (TimeoutError, zenoh.ZError):
            pass
        yield Ping(number=number, answer=answer, unix_s=time.time(), why=why)
        if number < count:
            await asyncio.sleep(due_at - loop.time())


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """Statistics of several measurements."""

    least: float
    """The smallest."""
    mean: float
    """Their mean."""
    most: float
    """The largest."""
    deviation: float
    """Standard deviation of the population."""


class PingStatistics(msgspec.Struct, frozen=True, kw_only=True):
    """Statistics of all pings."""

    sent: int
    """Number of pings."""
    answered: int
    """Number of answered ones."""
    round_trip_s: Spread | None
    """Round trips, s."""
    range_m: Spread | None
    """Ranges, m."""


def statistics_of(done: Sequence[Ping]) -> PingStatistics:
    """Return the statistics of pings."""
    answers = [ping.answer for ping in done if ping.answer is not None]
    return PingStatistics(
        sent=len(done),
        answered=len(answers),
        round_trip_s=_spread([each.round_trip_s for each in answers]),
        range_m=_spread([each.range_m for each in answers]),
    )


def _spread(found: Sequence[float | None]) -> Spread | None:
    values = [value for value in found if value is not None]
    if not values:
        return None
    mean = math.fsum(values) / len(values)
    variance = math.fsum((value - mean) ** 2 for value in values) / len(values)
    return Spread(least=min(values), mean=mean, most=max(values), deviation=math.sqrt(variance))
