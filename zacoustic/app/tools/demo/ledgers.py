"""The health reports of the gateways: their readiness, and what they sent.

This is a plain Zenoh client of each router, as any tool of a user can be. Zenoh calls back on its
own threads; the callbacks hand everything to the loop.

A gateway answers queries for its documents when its link is up and all streams are declared. Its
liveliness token comes earlier, and only shows that its address is taken. A put in between has no
subscriber: it would be lost, in particular with a modem that takes a second to start.
"""

import asyncio
import contextlib
import json
from collections.abc import Callable, Iterable
from functools import partial

import msgspec
import zenoh

from zacoustic.app.tools.demo.networks import LocalNetwork
from zacoustic.errors import SessionError
from zacoustic.run.inbox import tell_loop
from zacoustic.status.link import LedgerDocument

TookLedger = Callable[[int, dict[int, int]], None]
"""``(address, bytes by stream id)``: takes the ledger of a gateway, on the loop."""

_ATTEMPTS = 15
_ATTEMPT_MS = 1000
_GET_LIMIT_S = 2.0


class LedgerListener:
    """Listens to the gateways of the demo.

    Args:
        networks: The local networks with their routers.
        took: Takes each ledger.
    """

    def __init__(self, networks: Iterable[LocalNetwork], took: TookLedger) -> None:
        self._networks = tuple(networks)
        self._took = took
        self._loop = asyncio.get_running_loop()
        self._sessions: dict[int, zenoh.Session] = {}
        self._queriers: dict[int, zenoh.Querier] = {}
        self._is_closed = False
        self._answering = {
            local_network.address: asyncio.Event() for local_network in self._networks
        }

    async def open(self) -> None:
        """Connect to all networks; return when all gateways serve their streams.

        Raises:
            SessionError: A router does not answer.
        """
        for local_network in self._networks:
            await asyncio.to_thread(self._open, local_network)
        for event in self._answering.values():
            await event.wait()

    async def refresh(self) -> None:
        """Query each gateway for its ledger again."""
        for address, querier in self._queriers.items():
            for text in await asyncio.to_thread(_ask, querier):
                self._take(address, text)

    async def close(self) -> None:
        """Disconnect; may be repeated."""
        self._is_closed = True
        self._queriers.clear()
        while self._sessions:
            _, session = self._sessions.popitem()
            with contextlib.suppress(zenoh.ZError):
                await asyncio.to_thread(session.close)

    def _open(self, local_network: LocalNetwork) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([local_network.endpoint]))
        config.insert_json5("connect/timeout_ms", str(_ATTEMPT_MS))
        config.insert_json5("scouting/multicast/enabled", "false")
        session = self._connect(config)
        if session is None:
            raise SessionError(
                f"the router of the {local_network.name} network does not answer at "
                f"{local_network.endpoint}"
            )
        address = local_network.address
        self._sessions[address] = session

        def hear(sample: zenoh.Sample) -> None:
            tell_loop(self._loop, partial(self._take, address, sample.payload.to_string()))

        def see(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                tell_loop(self._loop, self._answering[address].set)

        session.declare_subscriber(f"@acoustic/{address}/ledger", hear)
        querier = session.declare_querier(f"@acoustic/{address}/ledger", timeout=_GET_LIMIT_S)
        self._queriers[address] = querier
        querier.declare_matching_listener(see)

    def _connect(self, config: zenoh.Config) -> zenoh.Session | None:
        """Try for a while, but not after a close: the process waits for this thread."""
        for _ in range(_ATTEMPTS):
            if self._is_closed:
                break
            with contextlib.suppress(zenoh.ZError):
                return zenoh.open(config)
        return None

    def _take(self, address: int, text: str) -> None:
        by_stream: dict[int, int] = {}
        for entry in msgspec.json.decode(text, type=LedgerDocument).entries:
            by_stream[entry.id] = by_stream.get(entry.id, 0) + entry.bytes
        self._took(address, by_stream)


def _ask(querier: zenoh.Querier) -> list[str]:
    return [reply.ok.payload.to_string() for reply in querier.get() if reply.ok is not None]
