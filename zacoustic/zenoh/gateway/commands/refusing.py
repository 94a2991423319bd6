"""Refusals of local queries whose answer should have come over the channel."""

from zacoustic.core.engine.events import CallFailed, CallFailure
from zacoustic.zenoh.session.asking.queries import HeldQuery


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
