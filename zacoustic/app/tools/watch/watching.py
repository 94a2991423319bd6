"""The watch: a Zenoh session that keeps a board up to date."""

import asyncio
import contextlib
import re
import threading
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Final, Self

import zenoh

from zacoustic.app.tools.watch.board import Board, addresses_in
from zacoustic.config import Config
from zacoustic.run.inbox import WakeUp, tell_loop
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.requests.report import ALL, REPORT
from zacoustic.zenoh.requests.request import PREFIX
from zacoustic.zenoh.session.session import ZenohSession

PULSE_S: Final = 0.5
"""Period of checks of the gateways, s: a hanging one leaves no other trace."""
PULSE_LIMIT_S: Final = 1.2
"""A gateway that does not answer a check within this time is gone until it does, s."""
ASK_S: Final = 30.0
"""Period of queries for everything, s: a put may be lost, and clocks drift."""
_ANSWER_LIMIT_S: Final = 5.0
# Documents that wait for the loop, one of each key. No fleet has more keys than this.
_KEYS_LIMIT: Final = 16_384
_TOKEN: Final = re.compile(rf"{PREFIX}/([0-9]{{1,3}})/gateway")


class Watch:
    """Watches all gateways of a local network; an asynchronous context manager, for the loop.

    Args:
        config: Names the router, or None.
        connect: Endpoints of the router; override the config.
        ask_s: Period of queries for everything, s.
    """

    def __init__(
        self, config: Config | None, connect: Sequence[str] | None, *, ask_s: float = ASK_S
    ) -> None:
        self.board = Board()
        """The newest documents."""
        self.changed = asyncio.Event()
        """Set after a reception; cleared by the waiting caller."""
        self.zenoh_session: ZenohSession
        """The session."""
        self._settings = session_config(config, connect)
        self._ask_s = ask_s
        self._loop = asyncio.get_running_loop()
        self._wake_up = WakeUp(self._loop, self._attend)
        self._guard = threading.Lock()
        self._news: dict[str, bytes] = {}
        self._alive: dict[int, bool] = {}
        self.is_connected = True
        """Whether there is a router, or another peer."""
        self._feeling: asyncio.Task[None] | None = None
        self._asking: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Open the session; returns when every present gateway has answered.

        Raises:
            SessionError: No router can be reached.
        """
        self.zenoh_session = await ZenohSession.open(self._settings)
        try:
            await self.zenoh_session.worker.run(self._declare)
            await self.ask()
        except BaseException:
            await self.zenoh_session.close()
            raise
        self._asking = asyncio.create_task(self._ask_again())
        self._feeling = asyncio.create_task(self._feel_pulses())
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        tasks = [task for task in (self._asking, self._feeling) if task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self.zenoh_session.close()

    async def ask(self) -> None:
        """Query all gateways for everything, and wait for their answers."""
        await self._get(ALL, _ANSWER_LIMIT_S)

    async def _get(self, document: str, limit_s: float) -> set[int]:
        """Query documents and wait for the answers; return the answering addresses."""
        ended = asyncio.Event()
        answered: set[int] = set()

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answered.update(addresses_in(str(reply.ok.key_expr)))
                self._take_sample(reply.ok)

        def get() -> None:
            self.zenoh_session.session.get(
                zenoh.KeyExpr(REPORT.key(None, document)),
                self.zenoh_session.callback(take, lambda: tell_loop(self._loop, ended.set)),
                timeout=limit_s,
                consolidation=zenoh.ConsolidationMode.NONE,
            )

        await self.zenoh_session.worker.run(get)
        await ended.wait()
        self._attend()
        return answered

    def _declare(self) -> None:
        session = self.zenoh_session.session
        session.declare_subscriber(
            zenoh.KeyExpr(f"{PREFIX}/**"), self.zenoh_session.callback(self._take_sample)
        )
        self.zenoh_session.watch(
            lambda is_up: tell_loop(self._loop, lambda: self._note_router(is_up))
        )
        session.liveliness().declare_subscriber(
            zenoh.KeyExpr(f"{PREFIX}/*/gateway"),
            self.zenoh_session.callback(self._see),
            history=True,
        )

    async def _ask_again(self) -> None:
        while True:
            await asyncio.sleep(self._ask_s)
            with contextlib.suppress(zenoh.ZError):  # the router is gone; it may come back
                await self.ask()

    async def _feel_pulses(self) -> None:
        """Check which gateways run: a hanging process keeps its session, and puts nothing."""
        while True:
            await asyncio.sleep(PULSE_S)
            known = self.board.addresses()
            answered: set[int] = set()
            with contextlib.suppress(zenoh.ZError):
                answered = await self._get("clock", PULSE_LIMIT_S)
            for address in known:
                self.board.note_answer(address, has_answered=address in answered)
            self.changed.set()

    def _note_router(self, is_up: bool) -> None:
        self.is_connected = is_up
        self.changed.set()

    # On threads of Zenoh's

    def _take_sample(self, sample: Any) -> None:  # noqa: ANN401 (Zenoh's stubs differ in it)
        key = str(sample.key_expr)
        with self._guard:
            if key not in self._news and len(self._news) >= _KEYS_LIMIT:
                return
            self._news[key] = sample.payload.to_bytes()
        self._wake_up.ring()

    def _see(self, sample: zenoh.Sample) -> None:
        found = _TOKEN.fullmatch(str(sample.key_expr))
        if found is None:
            return
        with self._guard:
            self._alive[int(found[1])] = sample.kind == zenoh.SampleKind.PUT
        self._wake_up.ring()

    # On the loop

    def _attend(self) -> None:
        with self._guard:
            news, self._news = self._news, {}
            alive, self._alive = self._alive, {}
        for key, payload in news.items():
            self.board.take(key, payload)
        for address, is_alive in alive.items():
            self.board.note_alive(address, is_alive=is_alive)
        self.changed.set()
