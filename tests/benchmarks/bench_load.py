"""What a put costs a gateway whose link is busy, and how old the data are that cross.

Five processes: two gateways on a simulated medium (64 bytes in 0.95 s), one program that publishes
and one that subscribes at the other end. A put costs the processor time of the first gateway, all
its threads, above that of a gateway to which nobody publishes. The age of a sample is the time from
its put to its callback, without the airtime of its frame. One topic has priority real_time and a
put every two seconds.

    python tests/benchmarks/bench_load.py [--topics 1 50 170] [--rate HZ] [--seconds S] [--strict]

`--rate` is that of each topic; `--flood N` adds a run with N puts a second over the last number of
topics. Compare commits by PYTHONPATH. Must hold: at most 0.03 ms a put over fifty topics at 20 Hz;
with a flood, data at most 0.5 s old, and real_time no later than with one put a second a topic.
"""

import argparse
import contextlib
import json
import os
import struct
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

import zenoh

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks.bench_gateway_latency import (
    Process,
    client_config,
    free_port,
    open_medium,
    percentile,
    settings_of,
)

COST_LIMIT_MS: Final = 0.03
AGE_LIMIT_S: Final = 0.5
_URGENT: Final = "bench/urgent"
_URGENT_PERIOD_S: Final = 2.0
_FRAME_S: Final = 0.951
_SCENARIO: Final = """{ profile: "evologics_s2c_18_34", channel: "none", nodes: [
  { address: 1, position: [0, 0, 10] }, { address: 2, position: [1, 0, 10] } ] }"""
_STAMP: Final = struct.Struct("<q")
_WARM_UP_S: Final = 5.0
_TICK_S: Final = 0.01


def main() -> int:
    """Measure, print a table, and say whether the limits hold."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--topics", type=int, nargs="+", default=[1, 50, 170])
    parser.add_argument("--rate", type=float, default=20.0, help="puts per second on each topic")
    parser.add_argument("--flood", type=float, default=0.0, help="puts per second in all")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--strict", action="store_true", help="exit with 1 when a limit is missed")
    parser.add_argument("--publish", type=float, nargs=4, help=argparse.SUPPRESS)
    parser.add_argument("--subscribe", type=float, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.publish:
        port, topics, rate_hz, seconds = arguments.publish
        publish(int(port), int(topics), rate_hz, seconds)
        return 0
    if arguments.subscribe:
        subscribe(int(arguments.subscribe[0]), arguments.subscribe[1])
        return 0
    columns = f"{'ms a put':>10}{'age p50':>9}{'p95':>6}{'urgent p50':>12}{'p95':>6}{'MB more':>9}"
    print(f"{'topics':>6}{'puts/s':>8}{columns}   (ages in s, without airtime)")
    most = arguments.topics[-1]
    runs = [(most, 0.0), (most, float(most))]
    runs += [(topics, topics * arguments.rate) for topics in arguments.topics]
    if arguments.flood:
        runs.append((most, arguments.flood))
    holds, idle, calm = True, None, None
    for topics, rate_hz in runs:
        found = measure(topics, rate_hz, arguments.seconds)
        calm = calm or (found if idle else None)
        idle = idle or found
        puts = max(1, found["puts"])
        cost_ms = (found["cpu_s"] - idle["cpu_s"]) / puts * 1e3 if rate_hz else 0.0
        ages = [f"{found[name]:.2f}" for name in ("age_p50", "age_p95", "urgent_p50", "urgent_p95")]
        print(
            f"{topics:6}{found['puts'] / arguments.seconds:8.0f}{cost_ms:10.4f}{ages[0]:>9}"
            f"{ages[1]:>6}{ages[2]:>12}{ages[3]:>6}{found['grown_mb']:9.1f}",
            flush=True,
        )
        if rate_hz and arguments.rate * topics == rate_hz and topics >= 50:
            holds &= cost_ms <= COST_LIMIT_MS
        holds &= not rate_hz or found["age_p95"] <= AGE_LIMIT_S
        holds &= calm is None or found["urgent_p95"] <= calm["urgent_p95"] * 1.1 + 0.05
    print("holds" if holds else "MISSED")
    return 1 if arguments.strict and not holds else 0


def measure(topics: int, rate_hz: float, seconds: float) -> dict[str, float]:
    """Run the processes once."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        locator = open_medium(_SCENARIO, folder, stack)
        ports, gateways = [free_port(), free_port()], []
        for address, port in enumerate(ports, 1):
            file = folder / f"{address}.json5"
            settings = settings_of(address, port, streams_of(topics))
            file.write_text(json.dumps(settings), encoding="utf-8")
            gateway = stack.enter_context(Process("gateway", file, "--link", locator, "--json"))
            gateway.wait_for("started")
            gateways.append(gateway)
        listens_s = seconds + _WARM_UP_S + 5
        subscriber = stack.enter_context(
            Process(None, __file__, "--subscribe", ports[1], listens_s)
        )
        subscriber.wait_for("ready")
        publisher = stack.enter_context(
            Process(None, __file__, "--publish", ports[0], topics, rate_hz, seconds)
        )
        publisher.wait_for("begins")
        pid = gateways[0].pid
        before_s, before_mb = cpu_s(pid), memory_mb(pid)
        puts = publisher.wait_for("done")["puts"]
        found = {"cpu_s": cpu_s(pid) - before_s, "grown_mb": memory_mb(pid) - before_mb}
        return {**found, "puts": puts, **subscriber.wait_for("ages")["ages"]}


def publish(port: int, topics: int, rate_hz: float, seconds: float) -> None:
    """Put at a steady rate over all topics, and an urgent sample now and then."""
    with zenoh.open(client_config(port)) as session:
        publishers = [session.declare_publisher(f"bench/t{each}") for each in range(topics)]
        urgent = session.declare_publisher(_URGENT)
        puts, begun, next_urgent = 0, time.monotonic(), 0.0
        is_counted = False
        while (now := time.monotonic() - begun) < seconds + _WARM_UP_S:
            if not is_counted and now >= _WARM_UP_S:
                is_counted, puts_before = True, puts
                print(json.dumps({"event": "begins"}), flush=True)
            if now >= next_urgent:
                urgent.put(_STAMP.pack(time.monotonic_ns()))
                next_urgent += _URGENT_PERIOD_S * (0.9 + 0.2 * ((puts * 7919) % 97) / 97)
            for _ in range(int(now * rate_hz) - puts):
                publishers[puts % topics].put(_STAMP.pack(time.monotonic_ns()))
                puts += 1
            time.sleep(_TICK_S)
        print(json.dumps({"event": "done", "puts": puts - puts_before}), flush=True)


def subscribe(port: int, seconds: float) -> None:
    """Take samples; print their ages without airtime, s."""
    ages: dict[bool, list[float]] = {True: [], False: []}
    begun = time.monotonic()

    def take(sample: zenoh.Sample) -> None:
        if time.monotonic() - begun >= _WARM_UP_S:
            (put_at,) = _STAMP.unpack(sample.payload.to_bytes())
            age_s = (time.monotonic_ns() - put_at) / 1e9
            ages[str(sample.key_expr) == _URGENT].append(max(0.0, age_s - _FRAME_S))

    with zenoh.open(client_config(port)) as session:
        session.declare_subscriber("bench/**", take)
        list(session.get("bench/fence"))
        print(json.dumps({"event": "ready"}), flush=True)
        threading.Event().wait(seconds)
    figures = {
        f"{name}_p{share * 100:.0f}": percentile(ages[is_urgent] or [float("inf")], share)
        for name, is_urgent in (("age", False), ("urgent", True))
        for share in (0.5, 0.95)
    }
    print(json.dumps({"event": "ages", "ages": figures}), flush=True)


def streams_of(topics: int) -> list[dict[str, Any]]:
    """Return the streams of both gateways."""
    return [
        {"id": 1, "topic": _URGENT, "publishers": [1], "priority": "real_time"},
        *({"id": 2 + n, "topic": f"bench/t{n}", "publishers": [1]} for n in range(topics)),
    ]


def cpu_s(pid: int) -> float:
    """Return the processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pid: int) -> float:
    """Return the resident memory of a process, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    sys.exit(main())
