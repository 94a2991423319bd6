"""A command to the local gateways, and their answers."""

import asyncio
from typing import Final

import zenoh

from zacoustic.core.engine.events import CallFailure
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.session.asking.commands import selector
from zacoustic.zenoh.session.asking.replies import read_error
from zacoustic.zenoh.session.session import ZenohSession

# Zenoh's own time limit is above the gateway's, because the gateway's error says more.
_BEHIND_S: Final = 2.0


class CommandQuery:
    """One `get` and its replies, which arrive on Zenoh's threads; for the loop.

    Args:
        node: Address; None: the nodes of all local gateways.
        command: The command.
        timeout_s: How long to try, s.
    """

    def __init__(self, node: int | None, command: RemoteCommand, timeout_s: float) -> None:
        self.command = command
        self.payloads: list[bytes] = []
        """Successful answers."""
        self.failures: list[tuple[CallFailure, str]] = []
        """Error answers."""
        self._key, self._parameters = selector(node, command, timeout_s)
        self._timeout_s = timeout_s
        self._loop = asyncio.get_running_loop()
        self._ended: asyncio.Future[None] = self._loop.create_future()

    @property
    def key(self) -> str:
        """Key expression of the `get`."""
        return self._key

    async def ask(self, zenoh_session: ZenohSession) -> None:
        """Send it, and wait for the last answer.

        Raises:
            ZError: It cannot be sent.
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
