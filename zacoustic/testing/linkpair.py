"""Two links that hear each other, and receivers that keep their reports, for checks.

The receiver checks *when* a link calls; `Side` waits, with limits that follow from the link's
capabilities. `zacoustic.testing.conformance` checks the results.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Final, Protocol

from zacoustic.core.base.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.base.linktypes import (
    BROADCAST,
    LinkState,
    Measurement,
    PeerMeasured,
    ReceivedFrame,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.link.contract import Link

ON_AIR: Final = frozenset(
    {TransmitOutcome.SENT, TransmitOutcome.DELIVERED, TransmitOutcome.NOT_DELIVERED}
)
"""Outcomes of a frame that was completely on the air."""
PATIENCE_S: Final = 10.0
"""Patience beyond the airtime of an awaited frame, s: the longest back-off of a stream, and room
for a busy machine."""
AT_ONCE_S: Final = 0.05
"""Longest time for `transmit`, s: five frames of a display; anything that waits for a device takes
longer."""


class LinkHarness(Protocol):
    """Two links that hear each other, and the means to disturb them."""

    addresses: tuple[int, int]
    """Acoustic addresses of the two links."""

    async def set_up(self) -> tuple[Link, Link]:
        """Start what the links need and return them, not open yet."""
        ...

    async def tear_down(self) -> None:
        """Release everything; the links are closed."""
        ...

    async def cut(self) -> bool:
        """Cut the byte streams to the devices, which can reconnect; False: there are none."""
        ...

    async def inject(self, nonsense: bytes) -> bool:
        """Make the devices send nonsense; False: they cannot."""
        ...


class RecordingReceiver:
    """Keeps all reports of a link, and checks when they come."""

    def __init__(self) -> None:
        self.frames: list[ReceivedFrame] = []
        self.reports: list[TransmitReport] = []
        self.states: list[tuple[LinkState, str]] = []
        self.carrier: list[bool] = []
        self.measurements: list[Measurement] = []
        self.faults: list[str] = []
        self.is_in_transmit = False
        self.is_closed = False
        self._changed = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    @property
    def received_bytes(self) -> bytes:
        """All received frames, joined."""
        return b"".join(frame.frame_bytes for frame in self.frames)

    def frame_received(self, frame: ReceivedFrame) -> None:
        """Keep a frame."""
        self._watch("frame_received")
        self._expect(frame.received_at <= time.monotonic_ns(), "received_at lies in the future")
        if self.frames:
            before = self.frames[-1].received_at
            self._expect(before <= frame.received_at, "received_at has decreased")
        self.frames.append(frame)

    def transmit_finished(self, report: TransmitReport) -> None:
        """Keep a report."""
        self._watch("transmit_finished")
        self._expect(report.started_at <= report.finished_at, "a report ends before it starts")
        self._expect(report.finished_at <= time.monotonic_ns(), "finished_at lies in the future")
        self.reports.append(report)

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """Keep a state."""
        self._watch("state_changed")
        self.states.append((state, detail))

    def carrier_changed(self, busy: bool) -> None:
        """Keep a change of the carrier."""
        self._watch("carrier_changed")
        self.carrier.append(busy)

    def measured(self, measurement: Measurement) -> None:
        """Keep a measurement."""
        self._watch("measured")
        if isinstance(measurement, PeerMeasured):
            at = measurement.measured_at
        else:
            at = measurement.read_at
        self._expect(at <= time.monotonic_ns(), "a measurement lies in the future")
        self.measurements.append(measurement)

    async def wait(self, what: str, condition: Callable[[], object], limit_s: float) -> None:
        """Wait until a condition about this receiver holds.

        Raises:
            AssertionError: It does not hold within the limit; the message names the condition.
        """
        try:
            async with asyncio.timeout(limit_s):
                while not condition():
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            seen = f"frames {len(self.frames)}, reports {self.reports}, states {self.states}"
            raise AssertionError(f"no {what} within {limit_s:.1f} s; {seen}") from None
        self.raise_faults()

    def raise_faults(self) -> None:
        """Raise the errors of callbacks; in a callback an exception would get lost in the loop.

        Raises:
            AssertionError: A callback broke a rule.
        """
        if self.faults:
            raise AssertionError("; ".join(self.faults))

    def _watch(self, method: str) -> None:
        self._expect(not self.is_in_transmit, f"{method} was called from within transmit")
        self._expect(not self.is_closed, f"{method} was called after close had returned")
        try:
            is_on_loop = asyncio.get_running_loop() is self._loop
        except RuntimeError:
            is_on_loop = False
        self._expect(is_on_loop, f"{method} was called off the loop")
        if is_on_loop:
            self._changed.set()

    def _expect(self, condition: bool, rule: str) -> None:
        if not condition:
            self.faults.append(rule)


class Side:
    """One of the two links, open, with its receiver."""

    def __init__(self, link: Link, address: int) -> None:
        self.link = link
        self.address = address
        self.receiver = RecordingReceiver()
        self._next_id = 1

    async def open(self) -> None:
        """Open, and wait until the link is UP."""
        await self.link.open(self.receiver)
        await self.receiver.wait("UP", lambda: self.is_up, PATIENCE_S)

    async def close(self) -> None:
        """Close; any later callback is a fault."""
        await self.link.close()
        self.receiver.is_closed = True

    @property
    def is_up(self) -> bool:
        """Whether the last state was UP."""
        states = self.receiver.states
        return bool(states) and states[-1][0] is LinkState.UP

    @property
    def limit_s(self) -> float:
        """Time limit for all reports of one frame, s; of all frames that a bulk service takes."""
        told = self.link.capabilities
        airtime_s = ns_to_seconds(told.airtime_ns(told.mtu_bytes))
        if told.bulk is not None:
            frame_ns = told.bulk.airtime_ns(told.bulk.mtu_bytes)
            airtime_s += ns_to_seconds(told.bulk.most_outstanding * frame_ns)
        return PATIENCE_S + 4 * (airtime_s + told.gap_s + told.propagation_s)

    def transmit(
        self,
        frame_bytes: bytes,
        destination: int = BROADCAST,
        *,
        acknowledge: bool = False,
        service: Service = Service.PLAIN,
    ) -> int:
        """Transmit, check that this returns at once without a callback, and return the id."""
        transmission_id = self._next_id
        self._next_id += 1
        self.receiver.is_in_transmit = True
        started_at = time.monotonic_ns()
        try:
            self.link.transmit(
                Transmission(
                    transmission_id=transmission_id,
                    frame_bytes=frame_bytes,
                    destination=destination,
                    acknowledge=acknowledge,
                    service=service,
                )
            )
        finally:
            self.receiver.is_in_transmit = False
        took_s = ns_to_seconds(time.monotonic_ns() - started_at)
        require(took_s < AT_ONCE_S, f"transmit took {took_s:.3f} s")
        return transmission_id

    async def report(self, transmission_id: int) -> TransmitReport:
        """Wait for the report of a transmission."""
        found: list[TransmitReport] = []

        def is_there() -> bool:
            found[:] = [
                report
                for report in self.receiver.reports
                if report.transmission_id == transmission_id
            ]
            return bool(found)

        await self.receiver.wait(f"report of {transmission_id}", is_there, self.limit_s)
        require(len(found) == 1, f"transmission {transmission_id} was reported {len(found)} times")
        return found[0]

    async def send(self, frame_bytes: bytes, destination: int = BROADCAST) -> TransmitReport:
        """Transmit, check that the frame was on the air, and wait for the pause after it."""
        report = await self.report(self.transmit(frame_bytes, destination))
        require(report.outcome in ON_AIR, f"a frame in order was {report}")
        await self.gap(report)
        return report

    async def hears(self, content: bytes) -> None:
        """Wait until exactly these bytes have been received, in order."""
        receiver = self.receiver

        def is_there() -> bool:
            return len(receiver.received_bytes) >= len(content)

        await receiver.wait(f"{len(content)} bytes", is_there, self.limit_s)
        require(receiver.received_bytes == content, "other bytes arrive than were sent")
        if self.link.capabilities.framed:
            require(all(frame.frame_bytes for frame in receiver.frames), "an empty frame arrived")

    async def gap(self, report: TransmitReport) -> None:
        """Wait for the pause that the device needs after a frame."""
        ready_at = report.finished_at + round(self.link.capabilities.gap_s * NS_PER_S)
        delay_ns = ready_at - time.monotonic_ns()
        if delay_ns > 0:
            over = asyncio.Event()
            asyncio.get_running_loop().call_later(ns_to_seconds(delay_ns), over.set)
            await over.wait()


@asynccontextmanager
async def pair(harness: LinkHarness, *, is_open: bool = True) -> AsyncIterator[tuple[Side, Side]]:
    """Set up the two links and open them by default; at the end close and check them.

    Raises:
        AssertionError: A callback broke a rule.
    """
    links = await harness.set_up()
    near, far = (Side(link, at) for link, at in zip(links, harness.addresses, strict=True))
    try:
        if is_open:
            await near.open()
            await far.open()
        yield near, far
        await near.close()
        await far.close()
        # The last chance to detect a late callback.
        await asyncio.sleep(0)
        near.receiver.raise_faults()
        far.receiver.raise_faults()
    finally:
        await near.close()
        await far.close()
        await harness.tear_down()


def require(condition: bool, rule: str) -> None:
    """Like `assert`, but ``python -O`` does not remove it."""
    if not condition:
        raise AssertionError(rule)
