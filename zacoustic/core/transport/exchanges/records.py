"""The records of exchanges: those that are said once, and the QoS of both kinds.

A confirmation is said once: if it is lost, the other end repeats what it confirms, and it is said
again.
"""

from typing import Final

import msgspec

from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.schedule.queue import QueuedRecord

_ANY_DEPTH: Final = 65535


def confirm(stream_id: int, destination: int, head: bytes, now: int) -> QueuedRecord:
    """Return a record without a payload that is said once."""
    return QueuedRecord(
        stream_id=stream_id,
        destination=destination,
        head=head,
        payload=b"",
        delimits_itself=True,
        for_one_node=True,
        cause=Cause.ACK,
        is_reply=True,
        queued_at=now,
    )


def once_qos(linger_s: float) -> Qos:
    """Return the QoS of what is said once; it lingers for up to `linger_s` to join a frame."""
    return Qos(priority=Priority.INTERACTIVE_HIGH, linger_s=linger_s)


def repeated_qos(qos: Qos) -> Qos:
    """Return the QoS of repeated records, which neither displace each other nor wait."""
    return msgspec.structs.replace(qos, depth=_ANY_DEPTH, lifespan_s=None, min_interval_s=0.0)
