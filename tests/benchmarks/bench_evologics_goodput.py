"""What the EvoLogics driver makes of the time that the modems leave it.

Two emulated modems, 300 m apart in water that loses nothing, and one sends instant messages of 64
bytes as fast as it may. The published timing permits one each 0.951 s (0.860 s of sound, 0.090 s of
processing), 539 bit/s. Three rows:

- the driver, in virtual time: what the dialogue with the modem costs, and how long its own code
  computes for each frame (processor time, both ends of the link);
- an engine on it, in virtual time: the bits of samples that arrive at the other engine, each in a
  frame of its own, the largest that fits;
- the driver in real time over TCP, four pairs of modems at once: the same, and how much later than
  the end of its sound a frame is reported. That end is a bare timer of the same event loop, set
  when the frame is given, so that a busy computer is not counted; what emulator and TCP take is, so
  the driver itself adds less.

Must hold: at least 95 % of the permitted bits in the rows without an engine; less than 5 ms for
each frame, of the driver's own (p99) and added over TCP (p50: the slowest of the frames there tell
of the other programs on the computer).

    python tests/benchmarks/bench_evologics_goodput.py [--frames N] [--json] [--strict]
"""

import argparse
import asyncio
import contextlib
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

# Run as a file, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.links.evologics.driver.crew import CrewedSea, CrewNode
from tests.links.evologics.driver.sea import Node, Sea
from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.linktypes import Transmission, TransmitOutcome
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import TAG_BYTES
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer
from zacoustic_evologics.airtime import GAP_NS, GAP_S, im_airtime_ns
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.emulator import EmulatedFleet, scenario_of
from zacoustic_evologics.link import EvologicsLink

FRAME_BYTES: Final = 64
PERMITTED_BPS: Final = 8e9 * FRAME_BYTES / (im_airtime_ns(FRAME_BYTES) + GAP_NS)
SHARE_LIMIT: Final = 0.95
LIMIT_MS: Final = 5.0
PAIRS: Final = 4

_STREAM_ID: Final = 10
# What an engine takes: a record of this size fits beside a tag and its own stream id.
_SAMPLE_BYTES: Final = FRAME_BYTES - TAG_BYTES - 1


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One row of the table."""

    what: str
    frames: int
    payload_bytes: int
    bit_per_s: float
    percent: float
    p50_ms: float | None = None
    p99_ms: float | None = None


def main() -> int:
    """Measure, print, and say whether the limits hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=32, help="per pair in real time")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--strict", action="store_true", help="exit with 1 when a limit is missed")
    arguments = parser.parse_args()
    driver, engine = run_driver(30 * arguments.frames), run_engines(30 * arguments.frames)
    tcp = asyncio.run(run_pairs(arguments.frames))
    verdicts = {
        f"driver: at least {SHARE_LIMIT:.0%}": driver.percent >= 100 * SHARE_LIMIT,
        f"over TCP: at least {SHARE_LIMIT:.0%}": tcp.percent >= 100 * SHARE_LIMIT,
        f"driver: p99 below {LIMIT_MS:g} ms": (driver.p99_ms or 0.0) < LIMIT_MS,
        f"over TCP: p50 below {LIMIT_MS:g} ms": (tcp.p50_ms or 0.0) < LIMIT_MS,
    }
    if arguments.json:
        rows = {"driver": driver, "engine": engine, "tcp": tcp}
        told = {name: msgspec.to_builtins(row) for name, row in rows.items()}
        print(json.dumps({"permitted_bit_per_s": PERMITTED_BPS, **told, "holds": verdicts}))
    else:
        report((driver, engine, tcp), verdicts)
    return 1 if arguments.strict and not all(verdicts.values()) else 0


def report(rows: Sequence[Row], verdicts: dict[str, bool]) -> None:
    """Print the table."""
    print(f"instant messages of {FRAME_BYTES} bytes; permitted: {PERMITTED_BPS:.1f} bit/s")
    print(f"{'':34}{'frames':>7}{'payload':>9}{'bit/s':>8}{'%':>7}{'ms: p50':>10}{'p99':>7}")
    for row in rows:
        line = f"{row.what:34}{row.frames:7d}{row.payload_bytes:7d} B"
        line += f"{row.bit_per_s:8.1f}{row.percent:7.1f}"
        if row.p50_ms is not None:
            line += f"{row.p50_ms:10.2f}{row.p99_ms:7.2f}"
        print(line)
    for limit, holds in verdicts.items():
        print(f"{limit}: {'holds' if holds else 'MISSED'}")


def run_driver(frames: int) -> Row:
    """Send frame after frame through two dialogues, in virtual time."""
    sea = TimedSea(scenario_of(2, spacing_m=300.0))
    sea.make_ready()
    began_at = sea.now
    driver_ms = []
    for number in range(frames):
        content = number.to_bytes(FRAME_BYTES, "big")
        before_ns = sea.driver_ns
        assert sea.send(1, content, 2).outcome is TransmitOutcome.SENT
        sea.run(GAP_S)
        driver_ms.append((sea.driver_ns - before_ns) / 1e6)
    lasted_s = ns_to_seconds(sea.now - began_at)
    sea.run(1.0)
    arrived = sum(len(each.frame_bytes) for each in sea[2].frames)
    row = _row("driver, virtual time", frames, FRAME_BYTES, arrived, lasted_s)
    return _timed(row, driver_ms)


def run_engines(samples: int) -> Row:
    """Publish more than fits the water, in virtual time."""
    arrived: list[tuple[int, int]] = []

    def deliver(node: CrewNode, event: Event) -> None:
        if isinstance(event, SampleReceived) and isinstance(event.value, bytes):
            arrived.append((sea.now, len(event.value)))

    topic = TopicSpec(stream_id=_STREAM_ID, name="goodput", publishers=(1,), qos=Qos(depth=2))
    sea = CrewedSea(
        EmulatedFleet(scenario_of(2, spacing_m=300.0)),
        StreamTable([topic]),
        deliver,
        config=EvologicsConfig(),
    )

    def publish() -> None:
        sea.apply(
            sea.crew[0], lambda engine, now: engine.publish(_STREAM_ID, bytes(_SAMPLE_BYTES), now)
        )

    def publish_again() -> None:
        publish()
        sea.after(0.5, publish_again)

    sea.until(lambda: all(node.is_up for node in sea.crew))
    for _ in range(3):
        publish()
        sea.run(20.0)  # the engines introduce themselves to each other
    publish_again()
    sea.until(lambda: len(arrived) >= 5)
    del arrived[:-1]
    sea.until(lambda: len(arrived) > samples, limit_s=2.0 * samples)
    lasted_s = ns_to_seconds(arrived[samples][0] - arrived[0][0])
    bytes_arrived = sum(size for _, size in arrived[1 : samples + 1])
    return _row("engine on it, virtual time", samples, _SAMPLE_BYTES, bytes_arrived, lasted_s)


async def run_pairs(frames: int) -> Row:
    """Send through links over TCP, in real time; several pairs at once."""
    pairs = [Pair(frames) for _ in range(PAIRS)]
    await asyncio.gather(*(pair.run() for pair in pairs))
    added_ms = [added for pair in pairs for added in pair.added_ms]
    slowest_s = max(pair.lasted_s for pair in pairs)
    arrived = min(pair.receiver.bytes_received for pair in pairs)
    row = _row("driver over TCP, real time", frames * PAIRS, FRAME_BYTES, arrived, slowest_s)
    return _timed(row, added_ms)


class TimedDialogue(AtDialogue):
    """A dialogue that counts the processor time of what it is called for."""

    spent_ns = 0

    def handle_bytes(self, received: bytes, now: int) -> None:
        with self._counting():
            super().handle_bytes(received, now)

    def handle_timeout(self, now: int) -> None:
        with self._counting():
            super().handle_timeout(now)

    def transmit(self, transmission: Transmission, now: int) -> None:
        with self._counting():
            super().transmit(transmission, now)

    @contextlib.contextmanager
    def _counting(self) -> Iterator[None]:
        began_ns = time.thread_time_ns()
        try:
            yield
        finally:
            self.spent_ns += time.thread_time_ns() - began_ns


class TimedSea(Sea):
    """A sea whose dialogues count their time."""

    def make_node(self, address: int, dialogue: AtDialogue) -> Node:
        timed = TimedDialogue(EvologicsConfig(), node_address=address, is_serial=False)
        return super().make_node(address, timed)

    @property
    def driver_ns(self) -> int:
        """Processor time of all dialogues so far."""
        dialogues = [node.dialogue for node in self.nodes.values()]
        return sum(each.spent_ns for each in dialogues if isinstance(each, TimedDialogue))


class Pair:
    """Two links to two modems of a fleet of their own.

    Args:
        frames: How many the first sends.
    """

    def __init__(self, frames: int) -> None:
        self.added_ms: list[float] = []
        self.lasted_s = 0.0
        self.receiver = Receiver()
        self._frames = frames

    async def run(self) -> None:
        """Measure."""
        server = EmulationServer(RunningEmulation(EmulatedFleet(scenario_of(2, spacing_m=300.0))))
        links: list[EvologicsLink] = []
        try:
            sender = Receiver()
            for address, receiver in ((1, sender), (2, self.receiver)):
                place = await server.listen(address, "127.0.0.1", 0)
                link = EvologicsLink.from_locator(
                    place.locator, EvologicsConfig(), node_address=address
                )
                await link.open(receiver)
                links.append(link)
            began_s = time.perf_counter()
            for number in range(self._frames):
                await self._send(links[0], sender, number)
            self.lasted_s = time.perf_counter() - began_s
            while self.receiver.bytes_received < self._frames * FRAME_BYTES:
                await self.receiver.next_change()
        finally:
            for link in links:
                await link.close()
            await server.close()

    async def _send(self, link: EvologicsLink, sender: "Receiver", number: int) -> None:
        content = number.to_bytes(FRAME_BYTES, "big")
        ended = asyncio.get_running_loop().create_future()

        def end() -> None:
            ended.set_result(time.perf_counter())

        asyncio.get_running_loop().call_later(im_airtime_ns(FRAME_BYTES) / 1e9, end)
        link.transmit(Transmission(transmission_id=number, frame_bytes=content, destination=2))
        while sender.reports <= number:
            await sender.next_change()
        reported_s = time.perf_counter()
        self.added_ms.append(1000 * (reported_s - await ended))
        await asyncio.sleep(link.capabilities.gap_s)


class Receiver:
    """Counts what a link tells."""

    def __init__(self) -> None:
        self.reports = 0
        self.bytes_received = 0
        self._changed = asyncio.Event()

    async def next_change(self) -> None:
        """Wait until something has been told."""
        self._changed.clear()
        await asyncio.wait_for(self._changed.wait(), 60.0)

    def frame_received(self, frame: Any) -> None:
        self.bytes_received += len(frame.frame_bytes)
        self._changed.set()

    def transmit_finished(self, report: Any) -> None:
        assert report.outcome is TransmitOutcome.SENT, report
        self.reports += 1
        self._changed.set()

    def state_changed(self, state: Any, detail: str = "") -> None:
        pass

    def carrier_changed(self, busy: bool) -> None:
        pass

    def measured(self, measurement: Any) -> None:
        pass


def _row(what: str, frames: int, payload_bytes: int, arrived: int, lasted_s: float) -> Row:
    bit_per_s = 8 * arrived / lasted_s
    return Row(
        what=what,
        frames=frames,
        payload_bytes=payload_bytes,
        bit_per_s=bit_per_s,
        percent=100 * bit_per_s / PERMITTED_BPS,
    )


def _timed(row: Row, durations_ms: Sequence[float]) -> Row:
    ordered = sorted(durations_ms)
    p50_ms, p99_ms = _percentile(ordered, 0.5), _percentile(ordered, 0.99)
    return msgspec.structs.replace(row, p50_ms=p50_ms, p99_ms=p99_ms)


def _percentile(ordered: Sequence[float], share: float) -> float:
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


if __name__ == "__main__":
    sys.exit(main())
