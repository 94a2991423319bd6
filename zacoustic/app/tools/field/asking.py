"""One question to the gateway that is responsible for a node, and its answer."""

import asyncio

from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import CallTimeoutError, DeliveryError, ServiceError
from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.session.asking.question import Question
from zacoustic.zenoh.session.session import ZenohSession

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


def no_answer(
    node: int | None, failure: tuple[CallFailure, str] | None
) -> DeliveryError | ServiceError:
    """Return the error for a question without an answer.

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
