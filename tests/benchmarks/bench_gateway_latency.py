"""What two gateways and a link add to the latency of a Zenoh put.

Four processes: a publisher and a gateway on one local network, a gateway and a subscriber on the
other. The gateways are joined by datagrams on the loopback interface, and in a second run by a
simulated medium, a fifth process: its water is ideal and 1 cm wide, so that nothing but software
delays. Each put carries the instant at which it was made, on the clock that all processes of a
computer share. A direct put, through the router of the first network to the same subscriber, is
measured in the same run, turn by turn. Must hold on a quiet computer, by datagrams: added p50 below
0.8 ms, added p99 below 10 ms.

    python tests/benchmarks/bench_gateway_latency.py [--samples N] [--rate HZ] [--strict]
"""

import argparse
import contextlib
import json
import queue
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import zenoh

P50_LIMIT_MS: Final = 0.8
P99_LIMIT_MS: Final = 10.0

DATAGRAMS: Final = "datagrams"
LINKS: Final = (DATAGRAMS, "medium")
DIRECT: Final = "bench/direct"
CHANNEL: Final = "bench/water"
LIMIT_S: Final = 30.0
# The first samples open connections, fill caches and confirm the stream tables.
WARM_UP: Final = 50

_STAMP: Final = struct.Struct("<qI")
_STREAMS: Final = [{"id": 1, "topic": CHANNEL, "publishers": [1], "depth": 16}]
_SCENARIO: Final = """{ profile: "ideal", channel: "none", nodes: [
  { address: 1, position: [0, 0, 10] }, { address: 2, position: [0.01, 0, 10] } ] }"""


def main() -> int:
    """Measure, print a table, and say whether the limits hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=2000, help="puts on each way")
    parser.add_argument("--rate", type=float, default=200.0, help="puts per second on each way")
    parser.add_argument("--strict", action="store_true", help="exit with 1 when a limit is missed")
    parser.add_argument("--subscribe", type=int, nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.subscribe:
        subscribe(*arguments.subscribe)
        return 0
    code = 0
    for link in LINKS:
        latencies_ms = measure(arguments.samples, 1 / arguments.rate, link)
        code |= report(latencies_ms, arguments.rate, link, strict=arguments.strict)
    return code


def report(latencies_ms: dict[str, list[float]], rate_hz: float, link: str, *, strict: bool) -> int:
    """Print the table; returns the exit code."""
    direct, channel = latencies_ms[DIRECT], latencies_ms[CHANNEL]
    print(f"put to callback, ms; {len(channel)} samples each way at {rate_hz:g} Hz")
    print(f"{'':24}{'p50':>8}{'p90':>8}{'p99':>8}{'max':>8}")
    for name, values in (("direct Zenoh put", direct), (f"two gateways, {link}", channel)):
        figures = (*(percentile(values, share) for share in (0.5, 0.9, 0.99)), max(values))
        print(f"{name:24}" + "".join(f"{figure:8.2f}" for figure in figures))
    holds = True
    for share, limit_ms in ((0.5, P50_LIMIT_MS), (0.99, P99_LIMIT_MS)):
        added_ms = percentile(channel, share) - percentile(direct, share)
        verdict = "holds" if added_ms < limit_ms else "MISSED"
        holds = holds and added_ms < limit_ms
        print(f"added p{share * 100:g}: {added_ms:.2f} ms, limit {limit_ms:g} ms: {verdict}")
    return 1 if strict and link == DATAGRAMS and not holds else 0


def percentile(values: Sequence[float], share: float) -> float:
    """The value below which that share lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def measure(samples: int, interval_s: float, link: str) -> dict[str, list[float]]:
    """Run the processes; returns the latencies by key, ms."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        locators = locators_of(link, folder, stack)
        ports = [free_port(), free_port()]
        for address, port, locator in zip((1, 2), ports, locators, strict=True):
            file = folder / f"{address}.json5"
            file.write_text(json.dumps(settings_of(address, port, _STREAMS)), encoding="utf-8")
            gateway = stack.enter_context(Process("gateway", file, "--link", locator, "--json"))
            gateway.wait_for("started")
        total = samples + WARM_UP
        subscriber = stack.enter_context(Process(None, __file__, "--subscribe", *ports, 2 * total))
        subscriber.wait_for("ready")
        with zenoh.open(client_config(ports[0])) as session:
            publish(session, total, interval_s)
        found = subscriber.wait_for("latencies")
    return {key: found[key][WARM_UP:] for key in (DIRECT, CHANNEL)}


def locators_of(link: str, folder: Path, stack: contextlib.ExitStack) -> list[str]:
    """Return the locators of both gateways; a medium runs until the end of the stack."""
    if link == DATAGRAMS:
        ends = [f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}" for _ in range(2)]
        return [
            f"udp/{own}#peers={other}&latency_s=0.01&bit_rate_bps=1000000000"
            for own, other in (ends, ends[::-1])
        ]
    return [open_medium(_SCENARIO, folder, stack)] * 2


def open_medium(scenario: str, folder: Path, stack: contextlib.ExitStack) -> str:
    """Start a medium, which runs until the end of the stack; returns its locator."""
    file = folder / "scenario.json5"
    file.write_text(scenario, encoding="utf-8")
    medium = stack.enter_context(Process("medium", file, "--listen", "127.0.0.1:0", "--json"))
    return f"sim/{medium.wait_for('listening')['address']}"


def publish(session: zenoh.Session, total: int, interval_s: float) -> None:
    """Put, turn by turn, at a steady rate."""
    publishers = [session.declare_publisher(key) for key in (DIRECT, CHANNEL)]
    next_s = time.monotonic()
    for number in range(total):
        for publisher in publishers:
            next_s += interval_s / 2
            time.sleep(max(0.0, next_s - time.monotonic()))
            publisher.put(_STAMP.pack(time.monotonic_ns(), number))


def subscribe(direct_port: int, channel_port: int, total: int) -> None:
    """The subscriber's process: take samples on both local networks, then print all latencies."""
    latencies_ms: dict[str, list[float]] = {DIRECT: [], CHANNEL: []}
    last_at = [time.monotonic()]
    done = threading.Event()

    def take(sample: zenoh.Sample) -> None:
        now = time.monotonic_ns()
        sent_at, _ = _STAMP.unpack(sample.payload.to_bytes())
        latencies_ms[str(sample.key_expr)].append((now - sent_at) / 1e6)
        last_at[0] = time.monotonic()
        if sum(map(len, latencies_ms.values())) == total:
            done.set()

    with (
        zenoh.open(client_config(direct_port)) as here,
        zenoh.open(client_config(channel_port)) as beyond,
    ):
        here.declare_subscriber(DIRECT, take)
        beyond.declare_subscriber(CHANNEL, take)
        for session in (here, beyond):  # the routers know of the subscribers then
            list(session.get("bench/fence"))
        print(json.dumps({"event": "ready"}), flush=True)
        # A sample that a newer one has replaced in a queue never comes.
        while not done.wait(1.0) and time.monotonic() - last_at[0] < 5.0:
            pass
    print(json.dumps({"event": "latencies", **latencies_ms}), flush=True)


class Process:
    """A process that prints JSON lines; ends with the `with` block.

    Args:
        verb: Verb of the command line, or None: a Python file.
        arguments: Its arguments.
    """

    def __init__(self, verb: str | None, *arguments: object) -> None:
        program = ["-m", "zacoustic", verb] if verb else []
        command = [sys.executable, *program, *map(str, arguments)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._lines: queue.Queue[str] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> "Process":
        self._reader.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(LIMIT_S)
        self._reader.join()
        assert self._process.stdout is not None
        self._process.stdout.close()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    def wait_for(self, event: str) -> dict[str, Any]:
        """Return the next line with that event."""
        while line := self._lines.get(timeout=10 * LIMIT_S):
            found: dict[str, Any] = json.loads(line)
            if found["event"] == event:
                return found
        raise RuntimeError(f"{self._process.args!r} ended before it said {event!r}")

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put("")


def settings_of(address: int, port: int, streams: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the file of one of two gateways."""
    return {
        "mode": "router",
        "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "plugins": {
            "acoustic": {
                "address": address,
                "nodes": [{"address": 1, "name": "near"}, {"address": 2, "name": "far"}],
                "streams": streams,
            }
        },
    }


def client_config(port: int) -> zenoh.Config:
    """Return the settings of a client of that router."""
    settings = {
        "mode": "client",
        "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": {"multicast": {"enabled": False}},
    }
    return zenoh.Config.from_json5(json.dumps(settings))


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Find a port that nobody listens on now."""
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    sys.exit(main())
