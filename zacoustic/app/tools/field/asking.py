"""Requests to the gateways of a local network, and their answers."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Sequence
from typing import TypeVar

import msgspec

from zacoustic.config import Config
from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import CallTimeoutError, DeliveryError, ServiceError
from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.session.asking.allreplies import ask_all
from zacoustic.zenoh.session.asking.question import Question
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
            raise no_answer(node, next(iter(found.failures), None))
        return [msgspec.json.decode(payload, type=request.answer) for _, payload in found.answers]


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


def no_answer(
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


# Zenoh's own limit is above the gateway's, whose answer is more precise.
_BEHIND_S = 2.0


async def ask_gateway(
    zenoh_session: ZenohSession, key: str, parameters: str, *, node: int, timeout_s: float
) -> bytes:
    """Query the local gateways; return what the responsible one answers.

    Args:
        zenoh_session: A session on their network.
        key: The key of the query.
        parameters: Its parameters.
        node: The node in it, for errors.
        timeout_s: How long the gateway tries, s.

    Raises:
        CallTimeoutError: No answer in time.
        ServiceError: The node refuses, with a reason.
        DeliveryError: The node cannot be asked.
    """
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    question = Question(key, lambda _: tell_loop(loop, ended.set))

    def ask() -> None:
        question.ask(
            zenoh_session,
            None,
            parameters=parameters,
            priority=Priority.DATA,
            timeout_s=timeout_s + _BEHIND_S,
        )

    await zenoh_session.worker.run(ask)
    await ended.wait()
    if question.good is not None:
        return question.good[0]
    raise no_answer(node, question.error)
