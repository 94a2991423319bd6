"""Requests to the gateways of a local network, and their answers."""

import contextlib
from collections.abc import AsyncIterator, Sequence
from typing import TypeVar

import msgspec

from zacoustic.config import Config
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.requests.asking import ask
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.session.session import ZenohSession

Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)


class Gateways:
    """The gateways of one local network.

    Args:
        zenoh_session: A session on it.
    """

    def __init__(self, zenoh_session: ZenohSession) -> None:
        self.zenoh_session = zenoh_session

    async def ask(self, request: Request[Q, A], node: int, question: Q, within_s: float) -> A:
        """Ask about one node, and return the answer.

        Args:
            request: The request.
            node: Address of the node.
            question: The question.
            within_s: Time limit, s.

        Raises:
            CallTimeoutError: No answer in time.
            ServiceError: The node refuses, with a reason.
            DeliveryError: The node cannot be asked, or no gateway knows it.
        """
        return (await ask(self.zenoh_session, request, node, question, within_s))[0]

    async def ask_all(self, request: Request[Q, A], question: Q, within_s: float) -> list[A]:
        """Ask each gateway about its own node; arguments and errors as of `ask`."""
        return await ask(self.zenoh_session, request, None, question, within_s)


@contextlib.asynccontextmanager
async def local_gateways(
    config: Config | None, connect: Sequence[str] | None
) -> AsyncIterator[Gateways]:
    """Open a session to ask the local gateways.

    Args:
        config: Names the router, or None.
        connect: Endpoints of the router; override the config.

    Raises:
        SessionError: No router can be reached.
    """
    zenoh_session = await ZenohSession.open(session_config(config, connect))
    try:
        yield Gateways(zenoh_session)
    finally:
        await zenoh_session.close()
