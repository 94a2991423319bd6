"""The conformance battery: the rules for every link, as plain async functions.

The author of a link writes a `LinkHarness`: two links that hear each other, through a simulator, an
emulator or two modems in a bucket, and the means to disturb them. Then, with pytest or without::

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
    def test_conformance(check):
        asyncio.run(check(MyHarness()))

The channel of a harness must be quiet and lose nothing: a lost frame fails a check. A failed check
is an `AssertionError` that names the broken rule of `zacoustic.link.contract`. Every wait has a
limit, which follows from the link's capabilities.
"""

import asyncio
import time
from collections.abc import Callable, Coroutine
from typing import Any, Final, TypeAlias, TypeGuard

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import (
    BROADCAST,
    BulkService,
    LinkMetrics,
    LinkState,
    Measurement,
    PeerMeasured,
    Service,
    TransmitOutcome,
)
from zacoustic.errors import LinkClosedError
from zacoustic.testing.linkpair import (
    ON_AIR,
    LinkHarness,
    RecordingReceiver,
    Side,
    pair,
    require,
)

GARBAGE: Final = bytes(range(256)) + b"\r\n\x00\xff" * 64
"""Nonsense for the byte stream of a device."""

Check: TypeAlias = Callable[[LinkHarness], Coroutine[Any, Any, None]]
"""One rule; raises `AssertionError` if a link breaks it."""


async def closes_twice_and_unopened(harness: LinkHarness) -> None:
    """`close` may be called before `open` and again after itself; `transmit` needs an open link."""
    async with pair(harness, is_open=False) as (near, far):
        await near.link.close()
        _require_closed(near)
        await near.open()
        await near.close()
        await near.close()
        _require_closed(near)
        await far.open()


async def says_what_it_can_do(harness: LinkHarness) -> None:
    """Capabilities are in range after `open`, and those that concern both sides are equal."""
    async with pair(harness) as (near, far):
        for side in (near, far):
            told = side.link.capabilities
            msgspec.convert(msgspec.to_builtins(told), type(told))  # runs its own checks
            low, high = told.address_range
            require(low <= side.address <= high, f"address {side.address} outside {low}..{high}")
            unknown = (told.reports | told.measures) - set(LinkMetrics.__struct_fields__)
            require(not unknown, f"{sorted(unknown)} are no fields of LinkMetrics")
            readings = side.link.diagnostics()
            require(
                all(isinstance(value, int | float | str) for value in readings.values()),
                "diagnostics are numbers and texts",
            )
            require(
                (LinkState.OPENING in [state for state, _ in side.receiver.states]) or side.is_up,
                "a link says that it opens",
            )


async def carries_frames_both_ways(harness: LinkHarness) -> None:
    """Frames of 1 byte and of all byte values arrive as they were sent, in both directions."""
    async with pair(harness) as sides:
        for near, far in (sides, sides[::-1]):
            limit = near.link.capabilities.mtu_bytes
            values = bytes(range(256))
            sent = [b"\x00", b"\xff", *(values[at : at + limit] for at in range(0, 256, limit))]
            for frame_bytes in sent[:12]:
                await near.send(frame_bytes)
            await far.hears(b"".join(sent[:12]))
            _require_sender(near, far)
            far.receiver.frames.clear()


async def carries_a_frame_of_mtu_bytes(harness: LinkHarness) -> None:
    """The largest frame arrives, unicast and broadcast, in one piece if the link has frames."""
    async with pair(harness) as (near, far):
        limit = near.link.capabilities.mtu_bytes
        frame_bytes = bytes(at % 251 for at in range(limit))
        await near.send(frame_bytes, far.address)
        await near.send(frame_bytes)
        await far.hears(2 * frame_bytes)
        if far.link.capabilities.framed:
            require(len(far.receiver.frames) == 2, "a frame arrived in pieces")
        _require_sender(near, far)


async def rejects_what_it_cannot_send(harness: LinkHarness) -> None:
    """A frame above the MTU and an empty frame are REJECTED by report and do no harm."""
    async with pair(harness) as (near, far):
        limit = near.link.capabilities.mtu_bytes
        for frame_bytes in (bytes(limit + 1), b"", bytes(100 * limit)):
            report = await near.report(near.transmit(frame_bytes))
            require(
                report.outcome is TransmitOutcome.REJECTED,
                f"a frame of {len(frame_bytes)} bytes, MTU {limit}, was {report.outcome.value}",
            )
            require(bool(report.detail), "a rejection says why")
        await near.send(b"present")
        await far.hears(b"present")


async def reports_each_transmission_once(harness: LinkHarness) -> None:
    """One report for each, even if another one is outstanding: then REJECTED at worst."""
    async with pair(harness) as (near, _):
        ids = [near.transmit(b"first"), near.transmit(b"second"), near.transmit(b"third")]
        reports = [await near.report(transmission_id) for transmission_id in ids]
        require(reports[0].outcome in ON_AIR, f"the first frame was {reports[0]}")
        on_air = [report for report in reports if report.outcome in ON_AIR]
        await near.gap(reports[0])
        last = await near.send(b"last")
        require(
            len(near.receiver.reports) == 4,
            f"four transmissions have {len(near.receiver.reports)} reports",
        )
        instants = [report.started_at for report in (*on_air, last)]
        require(instants == sorted(instants), "reports are not in the order of transmission")


async def lasts_as_long_as_it_says(harness: LinkHarness) -> None:
    """The airtime is that of the capabilities, within a quarter plus 50 ms."""
    async with pair(harness) as (near, _):
        told = near.link.capabilities
        for size in (1, told.mtu_bytes):
            called_at = time.monotonic_ns()
            report = await near.send(bytes(size))
            expected_s = ns_to_seconds(told.airtime_ns(size))
            lasted_s = ns_to_seconds(report.finished_at - report.started_at)
            require(report.started_at >= called_at, "started_at lies before the call")
            require(
                abs(lasted_s - expected_s) <= 0.25 * expected_s + 0.05,
                f"{size} bytes lasted {lasted_s:.3f} s; the capabilities say {expected_s:.3f} s",
            )


async def aborts_what_is_on_the_air_when_closed(harness: LinkHarness) -> None:
    """An outstanding transmission is reported before `close` returns."""
    async with pair(harness) as (near, far):
        transmission_id = near.transmit(bytes(near.link.capabilities.mtu_bytes))
        await near.close()
        reports = [report.transmission_id for report in near.receiver.reports]
        require(reports == [transmission_id], f"reports at close: {near.receiver.reports}")
        await far.close()


async def is_silent_after_close(harness: LinkHarness) -> None:
    """After `close` has returned, no callback comes, even while the other side goes on."""
    async with pair(harness) as (near, far):
        await far.close()
        await near.send(b"nobody")
        await near.send(b"hears")


async def measures_what_it_says(harness: LinkHarness) -> None:
    """Every received frame has the metrics named in `reports`."""
    async with pair(harness) as (near, far):
        await near.send(b"measure")
        await far.hears(b"measure")
        for frame in far.receiver.frames:
            for name in far.link.capabilities.reports:
                require(getattr(frame.metrics, name) is not None, f"{name} is not filled")


async def measures_ranges(harness: LinkHarness) -> None:
    """With `measures_range`: the propagation delay of an acknowledged exchange follows it."""
    async with pair(harness) as (near, far):
        told = near.link.capabilities
        if not told.measures_range:
            return
        require("propagation_s" in told.measures, "measures_range without propagation_s")
        for _ in range(2):
            called_at = time.monotonic_ns()
            report = await near.report(near.transmit(b"far?", far.address, acknowledge=True))
            require(report.outcome is TransmitOutcome.DELIVERED, f"a frame in order was {report}")
            # A report now may belong to the exchange before.
            await near.receiver.wait(
                "propagation delay of this exchange",
                lambda called_at=called_at: any(  # type: ignore[misc]
                    _delay_in(each) and each.measured_at >= called_at
                    for each in near.receiver.measurements
                ),
                near.limit_s,
            )
            await near.gap(report)
        delays = [each for each in near.receiver.measurements if _delay_in(each)]
        require(all(each.address == far.address for each in delays), "a delay of another node")
        filled = {
            name
            for each in near.receiver.measurements
            if isinstance(each, PeerMeasured)
            for name in LinkMetrics.__struct_fields__
            if getattr(each.metrics, name) is not None
        }
        require(filled <= told.measures, f"{sorted(filled - told.measures)} is not in measures")


async def senses_the_carrier(harness: LinkHarness) -> None:
    """With `senses_carrier`: busy while the other side is heard, then free; otherwise never."""
    async with pair(harness) as (near, far):
        await near.send(bytes(near.link.capabilities.mtu_bytes))
        await far.hears(bytes(near.link.capabilities.mtu_bytes))
        if far.link.capabilities.senses_carrier:
            heard = far.receiver.carrier
            await far.receiver.wait("free carrier", lambda: heard == [True, False], far.limit_s)
        else:
            require(not far.receiver.carrier, "carrier_changed without senses_carrier")


async def comes_back_after_a_cut(harness: LinkHarness) -> None:
    """A lost stream leads to DOWN, then by itself to UP; transmissions meanwhile are ABORTED."""
    async with pair(harness) as (near, far):
        if not await harness.cut():
            return
        for side in (near, far):
            await side.receiver.wait("DOWN", _has(side, LinkState.DOWN), side.limit_s)
        if not near.is_up:
            report = await near.report(near.transmit(b"lost"))
            require(
                report.outcome is TransmitOutcome.ABORTED,
                f"a frame was {report.outcome.value} while the link was down",
            )
        for side in (near, far):
            await side.receiver.wait("UP", _is_up(side), side.limit_s)
            require(any(text for state, text in side.receiver.states), "DOWN says why")
        await near.send(b"back")
        await far.hears(b"back")


async def reports_what_a_cut_interrupts(harness: LinkHarness) -> None:
    """A transmission that is outstanding when the stream is lost also has one report."""
    async with pair(harness) as (near, far):
        transmission_id = near.transmit(bytes(near.link.capabilities.mtu_bytes))
        if not await harness.cut():
            return
        await near.report(transmission_id)
        for side in (near, far):
            await side.receiver.wait("DOWN", _has(side, LinkState.DOWN), side.limit_s)
            await side.receiver.wait("UP", _is_up(side), side.limit_s)
        await near.report(transmission_id)


async def survives_garbage(harness: LinkHarness) -> None:
    """Nonsense from the device raises nothing, and frames pass again."""
    async with pair(harness) as (near, far):
        if not await harness.inject(GARBAGE):
            return
        content = b"after"
        async with asyncio.timeout(near.limit_s):
            while content not in far.receiver.received_bytes:
                # The link may have dropped and reopened the stream, once or more often.
                await near.receiver.wait("UP", lambda: near.is_up, near.limit_s)
                await far.receiver.wait("UP", lambda: far.is_up, far.limit_s)
                await near.report(near.transmit(content))
                await _turn(far.receiver, near.limit_s / 20)


async def carries_bulk_frames_both_ways(harness: LinkHarness) -> None:
    """With `bulk`: frames of 1 and of its MTU arrive as they were sent, with their sender."""
    async with pair(harness) as sides:
        for near, far in (sides, sides[::-1]):
            bulk = near.link.capabilities.bulk
            if bulk is None:
                return
            sent = [b"\x00", bytes(at % 251 for at in range(bulk.mtu_bytes))]
            for frame_bytes in sent:
                await _delivers(near, near.transmit(frame_bytes, far.address, service=Service.BULK))
            await far.hears(b"".join(sent))
            require(len(far.receiver.frames) == len(sent), "a frame arrived in pieces")
            services = {frame.service for frame in far.receiver.frames}
            require(services == {Service.BULK}, f"bulk frames arrived as {services}")
            _require_sender(near, far)
            far.receiver.frames.clear()


async def takes_as_many_bulk_frames_as_it_says(harness: LinkHarness) -> None:
    """With `bulk`: as many as `most_outstanding` at once, each reported once, none twice there."""
    async with pair(harness) as (near, far):
        bulk = near.link.capabilities.bulk
        if bulk is None:
            return
        sent, ids = _give(near, far.address, bulk, bulk.most_outstanding)
        last = near.transmit(b"one too many", far.address, service=Service.BULK)
        report = await near.report(last)
        require(report.outcome is TransmitOutcome.REJECTED, f"one too many was {report}")
        for transmission_id in ids:
            await _delivers(near, transmission_id)
        heard = sorted(frame.frame_bytes for frame in far.receiver.frames)
        require(heard == sorted(sent), "other frames arrive than were delivered")


async def carries_a_plain_frame_beside_bulk(harness: LinkHarness) -> None:
    """With `bulk`: a plain frame goes while bulk frames are outstanding, and all are reported."""
    async with pair(harness) as (near, far):
        bulk = near.link.capabilities.bulk
        if bulk is None:
            return
        _, ids = _give(near, far.address, bulk, 2)
        report = await near.report(near.transmit(b"plain"))
        require(report.outcome in ON_AIR, f"a plain frame beside bulk frames was {report}")
        for transmission_id in ids:
            await _delivers(near, transmission_id)
        await far.receiver.wait(
            "the plain frame",
            lambda: (
                (b"plain", Service.PLAIN)
                in [(frame.frame_bytes, frame.service) for frame in far.receiver.frames]
            ),
            far.limit_s,
        )


async def rejects_bulk_frames_that_it_cannot_send(harness: LinkHarness) -> None:
    """With `bulk`: such a frame that is too large, empty or for all nodes is REJECTED."""
    async with pair(harness) as (near, far):
        bulk = near.link.capabilities.bulk
        if bulk is None:
            return
        too_large = bytes(bulk.mtu_bytes + 1)
        wrong = [(b"for all", BROADCAST), (b"", far.address), (too_large, far.address)]
        for frame_bytes, destination in wrong:
            ended = near.transmit(frame_bytes, destination, service=Service.BULK)
            report = await near.report(ended)
            require(
                report.outcome is TransmitOutcome.REJECTED,
                f"a bulk frame of {len(frame_bytes)} bytes to {destination} was "
                f"{report.outcome.value}",
            )
            require(bool(report.detail), "a rejection says why")


async def aborts_bulk_frames_when_closed(harness: LinkHarness) -> None:
    """With `bulk`: each outstanding frame is reported once before `close` returns."""
    async with pair(harness) as (near, far):
        bulk = near.link.capabilities.bulk
        if bulk is None:
            return
        _, ids = _give(near, far.address, bulk, bulk.most_outstanding)
        await near.close()
        reports = sorted(report.transmission_id for report in near.receiver.reports)
        require(reports == ids, f"reports at close: {near.receiver.reports}")
        await far.close()


async def reports_bulk_frames_that_a_cut_interrupts(harness: LinkHarness) -> None:
    """With `bulk`: each frame that is outstanding when the stream is lost has one report."""
    async with pair(harness) as (near, far):
        bulk = near.link.capabilities.bulk
        if bulk is None:
            return
        _, ids = _give(near, far.address, bulk, bulk.most_outstanding)
        if not await harness.cut():
            return
        for side in (near, far):
            await side.receiver.wait("DOWN", _has(side, LinkState.DOWN), side.limit_s)
            await side.receiver.wait("UP", _is_up(side), side.limit_s)
        for transmission_id in ids:
            await near.report(transmission_id)


CHECKS: Final[tuple[Check, ...]] = (
    closes_twice_and_unopened,
    says_what_it_can_do,
    carries_frames_both_ways,
    carries_a_frame_of_mtu_bytes,
    rejects_what_it_cannot_send,
    reports_each_transmission_once,
    lasts_as_long_as_it_says,
    aborts_what_is_on_the_air_when_closed,
    is_silent_after_close,
    measures_what_it_says,
    measures_ranges,
    senses_the_carrier,
    comes_back_after_a_cut,
    reports_what_a_cut_interrupts,
    survives_garbage,
    carries_bulk_frames_both_ways,
    takes_as_many_bulk_frames_as_it_says,
    carries_a_plain_frame_beside_bulk,
    rejects_bulk_frames_that_it_cannot_send,
    aborts_bulk_frames_when_closed,
    reports_bulk_frames_that_a_cut_interrupts,
)
"""All checks."""


def _delay_in(measurement: Measurement) -> TypeGuard[PeerMeasured]:
    if not isinstance(measurement, PeerMeasured):
        return False
    return measurement.metrics.propagation_s is not None


def _give(side: Side, address: int, bulk: BulkService, count: int) -> tuple[list[bytes], list[int]]:
    """Give bulk frames of which no two are equal to a link; return them and their ids."""
    size = min(bulk.mtu_bytes, 80)
    sent = [bytes((number,)) * size for number in range(count)]
    return sent, [side.transmit(each, address, service=Service.BULK) for each in sent]


async def _delivers(side: Side, transmission_id: int) -> None:
    report = await side.report(transmission_id)
    require(report.outcome is TransmitOutcome.DELIVERED, f"a bulk frame in order was {report}")


def _require_closed(side: Side) -> None:
    try:
        side.transmit(b"x")
    except LinkClosedError:
        return
    raise AssertionError("transmit on a closed link raises no LinkClosedError")


def _require_sender(near: Side, far: Side) -> None:
    """The source is right if the link carries addresses, otherwise 0."""
    expected = near.address if far.link.capabilities.addressed else 0
    sources = {frame.source for frame in far.receiver.frames}
    require(sources == {expected}, f"source is {sources}; the sender was {expected}")


def _is_up(side: Side) -> Callable[[], bool]:
    return lambda: side.is_up


def _has(side: Side, state: LinkState) -> Callable[[], bool]:
    return lambda: any(each is state for each, _ in side.receiver.states)


async def _turn(receiver: RecordingReceiver, limit_s: float) -> None:
    """Wait until anything happens at a receiver, up to a limit."""
    seen = len(receiver.frames) + len(receiver.states)
    try:
        await receiver.wait(
            "news", lambda: len(receiver.frames) + len(receiver.states) > seen, limit_s
        )
    except AssertionError:
        return
