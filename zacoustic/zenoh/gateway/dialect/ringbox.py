"""Samples of one key, in a ring channel of Zenoh's until the loop looks for them.

A callback takes the interpreter's lock for each sample; a ring channel is filled without it and
keeps the newest. But a ring wakes nobody. So a second subscriber of the same key, a callback that
only says that something is there, wakes the loop as long as samples are rare (`listen`). Where they
are many and their link is busy, the loop looks by itself instead (`RingBox.is_polled`). The data
always comes by the ring, so changing from one to the other neither loses nor repeats a sample, and
Zenoh tells the network of both subscribers as one.
"""

from collections import deque
from collections.abc import Callable
from typing import Any, Final

import zenoh

from zacoustic.core.base.clock import Clock
from zacoustic.core.values.encoding import LARGEST_VALUE_BYTES
from zacoustic.zenoh.gateway.dialect.mailbox import (
    MAILBOX_LIMIT_BYTES,
    PARCEL_OVERHEAD_BYTES,
    Parcel,
)
from zacoustic.zenoh.session.session import ZenohSession

LOOK_NS: Final = 100_000_000
"""Interval at which the loop looks into a ring, ns: the arrival of a sample is known as well."""
_LEAST_KEPT: Final = 16
"""A ring keeps at least so many samples: up to 160 a second, each is counted."""


class RingBox:
    """The newest samples of one key; for the loop, unless stated otherwise.

    Args:
        depth: Newest samples kept, ≥ 1.
        is_marked: Tells whether an attachment is that of a sample from the channel.
        clock: Source of instants.
    """

    def __init__(self, depth: int, is_marked: Callable[[bytes], bool], clock: Clock) -> None:
        self.superseded = 0
        """Samples that newer ones replaced before they were taken, as far as they were seen."""
        self.oversized = 0
        """Samples with a payload above `LARGEST_VALUE_BYTES`."""
        self.seen = 0
        """Samples that were found in the ring."""
        self.is_polled = False
        """Whether samples wake nobody."""
        self._kept: deque[tuple[zenoh.Sample, int]] = deque()
        self._kept_bytes = 0
        self._depth = depth
        self._capacity = max(depth, _LEAST_KEPT)
        self._is_marked = is_marked
        self._clock = clock
        self._looked_at = 0
        self._woken_at = 0
        self._ring: Any = None
        self._waker: Any = None
        self._wake: Callable[[], zenoh.handlers.Callback[zenoh.Sample]] | None = None
        self._session: zenoh.Session | None = None
        self._expression = ""

    # In the worker

    def declare(
        self, zenoh_session: ZenohSession, expression: str, arrived: Callable[[], None]
    ) -> None:
        """Subscribe.

        Args:
            zenoh_session: The session.
            expression: The key.
            arrived: Called on Zenoh's thread for each sample while samples are rare.
        """

        def wake(_: zenoh.Sample) -> None:
            self._woken_at = self._clock()
            arrived()

        self._session, self._expression = zenoh_session.session, expression
        self._wake = lambda: zenoh_session.callback(wake)
        self._ring = self._session.declare_subscriber(
            zenoh.KeyExpr(expression),
            zenoh.handlers.RingChannel(self._capacity),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self.is_polled = False
        self.listen()

    def listen(self) -> None:
        """Let samples wake the loop, or no longer, as `is_polled` says."""
        if self._session is None or self._wake is None:
            return
        if self.is_polled and self._waker is not None:
            self._waker.undeclare()
            self._waker = None
        elif not self.is_polled and self._waker is None:
            self._waker = self._session.declare_subscriber(
                zenoh.KeyExpr(self._expression),
                self._wake(),
                allowed_origin=zenoh.Locality.REMOTE,
            )

    def undeclare(self) -> None:
        """Unsubscribe; samples in the ring are lost."""
        ring, waker = self._ring, self._waker
        self._ring = self._waker = self._session = None
        for each in (ring, waker):
            if each is not None:
                each.undeclare()

    # On the loop

    @property
    def oldest_at(self) -> int | None:
        """Arrival of its oldest sample, ns; None: it has none."""
        return self._kept[0][1] if self._kept else None

    def __len__(self) -> int:
        return len(self._kept)

    def look(self, now: int) -> None:
        """Empty the ring; a sample that woke nobody arrived between the last look and now."""
        ring = self._ring
        if ring is None:
            return
        found: list[zenoh.Sample] = []
        try:
            while len(found) < self._capacity and (sample := ring.try_recv()) is not None:
                found.append(sample)
        except zenoh.ZError:
            pass  # it has just been undeclared
        before, self._looked_at = self._looked_at, now
        self.seen += len(found)
        if not self.is_polled:
            arrived_at = min(self._woken_at, now) if self._woken_at > before else now
            for sample in found:
                self._keep(sample, arrived_at)
        elif found:
            step_ns = min(now - before, LOOK_NS) // len(found)
            for place, sample in enumerate(found, 1):
                self._keep(sample, now - step_ns * (len(found) - place) - step_ns // 2)

    def take(self) -> list[Parcel]:
        """Take the samples, in order of arrival."""
        parcels = [
            Parcel(
                str(sample.key_expr),
                sample.payload.to_bytes(),
                str(sample.encoding),
                sample.kind == zenoh.SampleKind.DELETE,
                arrived_at,
            )
            for sample, arrived_at in self._kept
        ]
        self._kept.clear()
        self._kept_bytes = 0
        return parcels

    def _keep(self, sample: zenoh.Sample, arrived_at: int) -> None:
        attachment = sample.attachment
        if attachment is not None and self._is_marked(attachment.to_bytes()):
            return  # it came from the channel
        if len(sample.payload) > LARGEST_VALUE_BYTES:
            self.oversized += 1
            return
        self._kept.append((sample, arrived_at))
        self._kept_bytes += len(sample.payload) + PARCEL_OVERHEAD_BYTES
        while len(self._kept) > self._depth or self._kept_bytes > MAILBOX_LIMIT_BYTES:
            oldest, _ = self._kept.popleft()
            self._kept_bytes -= len(oldest.payload) + PARCEL_OVERHEAD_BYTES
            self.superseded += 1
