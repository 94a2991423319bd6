"""Requests to the gateways of a local network, and their answers."""

import contextlib
from collections.abc import AsyncIterator, Sequence
from typing import TypeVar

import msgspec

from zacoustic.config import Config
from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import CallTimeoutError, DeliveryError, ServiceError
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.session.asking.allreplies import ask_all
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
        return (await self._ask(request, node, question, within_s))[0]

    async def ask_all(self, request: Request[Q, A], question: Q, within_s: float) -> list[A]:
        """Ask each gateway about its own node; arguments and errors as of `ask`."""
        return await self._ask(request, None, question, within_s)

    async def _ask(
        self, request: Request[Q, A], node: int | None, question: Q, within_s: float
    ) -> list[A]:
        key, parameters = request.selector(node, question, within_s)
        found = await ask_all(
            self.zenoh_session,
            key,
            parameters,
            timeout_s=within_s,
            is_first_enough=node is not None,
        )
        if not found.answers:
            raise _no_answer(node, next(iter(found.failures), None))
        return [request.decode(payload) for _, payload in found.answers]


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


def _no_answer(
    node: int | None, failure: tuple[CallFailure, str] | None
) -> DeliveryError | ServiceError:
    """Return the error for a request without an answer.

    Args:
        node: The node in it; None: those of all local gateways.
        failure: The error reply; None: nobody has replied.
    """
    if failure is None:
        which = "no gateway is" if node is None else f"no gateway that knows node {node} is"
        return DeliveryError(
            f"{which} on this local network", hint="is it running, and is --connect its router?"
        )
    kind, text = failure
    if kind is CallFailure.TIMED_OUT:
        return CallTimeoutError(text)
    if kind is CallFailure.HANDLER:
        return ServiceError(f"refused by node {node}: {text}")
    return DeliveryError(text)
