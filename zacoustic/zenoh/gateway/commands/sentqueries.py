"""Queries of the local network whose answer comes over the channel."""

from typing import Generic, TypeVar

from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.zenoh.session.asking.queries import HeldQuery

About = TypeVar("About")


class SentQueries(Generic[About]):
    """The queries that wait for another node, each with what its answer needs."""

    def __init__(self) -> None:
        self._sent: dict[int, tuple[HeldQuery, About]] = {}

    def add(self, call_id: int, held: HeldQuery, about: About) -> None:
        """Let a query wait for the end of a call."""
        self._sent[call_id] = held, about

    def take(self, event: ResponseReceived | CallFailed) -> tuple[HeldQuery, About] | None:
        """Return the query whose call has ended; None: the call was made for none of these."""
        return self._sent.pop(event.call_id, None)


def refuse_failed(held: HeldQuery, event: CallFailed, node: int, *, maybe: str = "") -> None:
    """Tell the asker that a node has not done what was asked.

    Args:
        held: The query.
        event: How the call failed.
        node: The node.
        maybe: What may have happened there although no answer came in time.
    """
    text = event.text
    if event.failure is CallFailure.TIMED_OUT:
        text = f"node {node} has not answered in time{maybe and f', and {maybe}'}"
    held.refuse(event.failure, text)
