"""Requests to the gateways of a local network, and their answers."""

from typing import TypeVar

import msgspec

from zacoustic.errors import DeliveryError
from zacoustic.zenoh.requests.context import request_error
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.session.asking.allreplies import ask_all
from zacoustic.zenoh.session.session import ZenohSession

Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)


async def ask(
    zenoh_session: ZenohSession,
    request: Request[Q, A],
    node: int | None,
    question: Q,
    within_s: float,
) -> list[A]:
    """Ask about one node, or each local gateway about its own.

    Args:
        zenoh_session: A session on the local network.
        request: The request.
        node: Address of the node; None: the nodes of all local gateways.
        question: The question.
        within_s: Time limit, s.

    Returns:
        The answers, at least one; about one node exactly one.

    Raises:
        CallTimeoutError: No answer in time.
        ServiceError: The node refuses, with a reason.
        DeliveryError: The node cannot be asked, or no gateway knows it.
        ZError: Nothing can be asked.
    """
    key, parameters = request.selector(node, question, within_s)
    found = await ask_all(
        zenoh_session, key, parameters, timeout_s=within_s, is_first_enough=node is not None
    )
    if found.answers:
        answers = found.answers if node is None else found.answers[:1]
        return [request.decode(payload) for _, payload in answers]
    if found.failures:
        raise request_error(node, *found.failures[0])
    which = "no gateway is" if node is None else f"no gateway that knows node {node} is"
    raise DeliveryError(
        f"{which} on this local network", hint="is it running, and is --connect its router?"
    )
