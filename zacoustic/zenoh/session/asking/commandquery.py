"""A question to the local gateways: a command, and their answers."""

import asyncio
from typing import Final

import zenoh

from zacoustic.core.engine.events import CallFailure
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.zenoh.session.asking.commands import selector
from zacoustic.zenoh.session.asking.replies import read_error
from zacoustic.zenoh.session.session import ZenohSession
from zacoustic.zenoh.session.wake_up import tell_loop

# Zenoh's own limit is above the gateway's, whose error says more.
_BEHIND_S: Final = 2.0


class CommandQuery:
    """One `get` and its replies, which come on threads of Zenoh's; for the loop.

    Args:
        node: Address; None: the nodes of all local gateways.
        command: The question or the command.
        timeout_s: How long to try, s.
    """

    def __init__(self, node: int | None, command: RemoteCommand, timeout_s: float) -> None:
        self.command = command
        self.payloads: list[bytes] = []
        """The good answers."""
        self.failures: list[tuple[CallFailure, str]] = []
        """The other ones."""
        self._key, self._parameters = selector(node, command, timeout_s)
        self._timeout_s = timeout_s
        self._loop = asyncio.get_running_loop()
        self._ended: asyncio.Future[None] = self._loop.create_future()

    @property
    def key(self) -> str:
        """Where it is asked."""
        return self._key

    async def ask(self, zenoh_session: ZenohSession) -> None:
        """Ask, and wait for the last answer.

        Raises:
            ZError: It cannot be asked.
        """
        await zenoh_session.worker.run(lambda: self._get(zenoh_session))
        await self._ended

    def _get(self, zenoh_session: ZenohSession) -> None:
        zenoh_session.session.get(
            zenoh.Selector(zenoh.KeyExpr(self._key), self._parameters or None),
            zenoh_session.callback(self._take, self._end),
            timeout=self._timeout_s + _BEHIND_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def _take(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self.payloads.append(reply.ok.payload.to_bytes())
        elif reply.err is not None:
            payload, encoding = reply.err.payload.to_bytes(), str(reply.err.encoding)
            self.failures.append(read_error(self._key, payload, encoding))

    def _end(self) -> None:
        tell_loop(self._loop, self._settle)

    def _settle(self) -> None:
        if not self._ended.done():
            self._ended.set_result(None)
