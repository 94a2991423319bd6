"""`config init` on three live systems that nobody tuned: lines edited by hand, airtime as planned.

    .venv/bin/python tests/benchmarks/bench_init.py [SECONDS] [json|cbor|ros …]

For each system a vehicle of twelve topics runs on a Zenoh router. `zacoustic config init` listens
to it and to the shore, and writes both sides' files and a scenario of what was published, which is
planned; the only hand is one that names the modem in each file. Two gateways
then run with them over a simulated channel, in real time, for `SECONDS` (300 unless told
otherwise). Printed are the edited lines, the topics that have crossed, and the share of the time on
the air: planned from the scenario, and measured. Exits 1 when more than three lines were edited, a
topic has not crossed, or the plan is more than 10 % off.
"""

import asyncio
import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import zenoh

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.gateway.networks import free_port, zenoh_config
from tests.gateway.rosnode import Node, ros_session
from tests.tools.untuned import OBSERVED_S, ROS, SYSTEMS, Published, System

SECONDS: Final = 300.0
ALLOWED: Final = 0.10
MOST_EDITED: Final = 3
SETTLING_S: Final = 60.0
"""How long the gateways run before it counts: they meet first."""
PROGRAM: Final = (sys.executable, "-m", "zacoustic")
CHANNEL: Final = {
    "channel": "none",
    "nodes": [{"address": 1, "name": "auv1", "position": [1000, 0, 30]},
              {"address": 2, "name": "shore", "position": [0, 0, 10]}],
}  # fmt: skip
"""The channel; `init` gives the side that it listens to the first address."""


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one system."""

    name: str
    """The system."""
    edited: int
    """Lines edited by hand, in both files."""
    crossed: int
    """Topics of which a sample has crossed."""
    topics: int
    """Topics of the system."""
    planned: float
    """Planned share of the time on the air."""
    measured: float
    """The measured one."""

    @property
    def off(self) -> float:
        """How far the plan is off, relatively."""
        return self.planned / self.measured - 1.0 if self.measured else 1.0

    @property
    def holds(self) -> bool:
        """Whether it is as it must be."""
        is_near = abs(self.off) <= ALLOWED
        return self.edited <= MOST_EDITED and self.crossed == self.topics and is_near


def main() -> int:
    """Print the table and return the exit code."""
    words = sys.argv[1:]
    seconds = float(words.pop(0)) if words and words[0][0].isdigit() else SECONDS
    systems = [each for each in (*SYSTEMS, ROS) if not words or each.name in words]
    print(f"{seconds:g} s each\nsystem  edited  crossed   planned  measured      off")
    holds = True
    for system in systems:
        with tempfile.TemporaryDirectory() as folder:
            found = asyncio.run(tried(system, Path(folder), seconds))
        holds = holds and found.holds
        print(
            f"{found.name:6s}  {found.edited:6d}  {found.crossed:3d} of {found.topics:2d}  "
            f"{found.planned:8.2%}  {found.measured:8.2%}  {found.off:+7.2%}"
            f"{'' if found.holds else '   NO'}",
            flush=True,
        )
    return 0 if holds else 1


async def tried(system: System, folder: Path, seconds: float) -> Outcome:
    """Let a system run, write its files, and run the gateways with them."""
    vehicle_port, shore_port, observed_port, medium_port = (free_port() for _ in range(4))
    with contextlib.ExitStack() as stack:
        stack.enter_context(zenoh.open(_router(vehicle_port)))
        vehicle = stack.enter_context(living(system, vehicle_port, is_shore=False))
        # The shore's programs run as well while `init` listens, on a router of their own.
        with (
            zenoh.open(_router(observed_port)),
            living(system, observed_port, is_shore=True),
        ):
            await asyncio.to_thread(
                zacoustic, folder, "config", "init", "--connect", f"tcp/127.0.0.1:{vehicle_port}",
                "--listen-s", str(OBSERVED_S), "--output", "auv1.json5", "--peer", "shore.json5",
                "--peer-connect", f"tcp/127.0.0.1:{observed_port}",
                "--peer-listen", f"tcp/127.0.0.1:{shore_port}", "--traffic", "traffic.json5",
            )  # fmt: skip
        edited = sum(
            name_modem(folder / name, f"sim/127.0.0.1:{medium_port}")
            for name in ("auv1.json5", "shore.json5")
        )
        (folder / "water.json5").write_text(json.dumps(CHANNEL), encoding="utf-8")
        report = await asyncio.to_thread(
            zacoustic, folder, "config", "plan", "traffic.json5", "--hours", "1", "--json"
        )
        plan = json.loads(report)
        planned = plan["utilisation"]
        for misfit in plan["misfits"]:
            print(f"{system.name}: {misfit}")
        medium = ("run", "medium", "water.json5", "--listen", f"127.0.0.1:{medium_port}")
        stack.enter_context(running(folder, *medium))
        await asyncio.sleep(5)
        for name in ("shore", "auv1"):
            stack.enter_context(running(folder, "run", "gateway", f"{name}.json5"))
        await asyncio.sleep(15)
        shore = stack.enter_context(living(system, shore_port, is_shore=True))
        await asyncio.sleep(SETTLING_S)
        before = airtime_s(vehicle_port, shore_port)
        began = time.monotonic()
        await asyncio.sleep(seconds)
        spent_s = airtime_s(vehicle_port, shore_port) - before
        measured = spent_s / (time.monotonic() - began)
        crossed = shore() | vehicle()
    missing = [topic.name for topic in system.topics if topic.name not in crossed]
    if missing:
        print(f"{system.name}: not crossed: {', '.join(missing)}")
    return Outcome(
        name=system.name, edited=edited, crossed=len(crossed), topics=len(system.topics),
        planned=planned, measured=measured,
    )  # fmt: skip


def name_modem(path: Path, locator: str) -> int:
    """Do what a user does by hand; returns how many lines it has changed."""
    before = path.read_text(encoding="utf-8").splitlines()
    after = [line.replace("sim/127.0.0.1:7000", locator) for line in before]
    path.write_text("\n".join(after), encoding="utf-8")
    return sum(old != new for old, new in zip(before, after, strict=True))


def zacoustic(folder: Path, *words: str) -> str:
    """Run a command to its end; returns its output. `plan` may say that something does not fit."""
    done = subprocess.run(
        [*PROGRAM, *words], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        print(f"{' '.join(words[:2])}: {done.returncode} {done.stderr.strip()}")
    return done.stdout


@contextlib.contextmanager
def running(folder: Path, *words: str) -> Iterator[None]:
    """Run a command beside the others."""
    with (folder / f"{words[1]}-{words[2]}.log").open("w") as log:
        process = subprocess.Popen([*PROGRAM, *words], cwd=folder, stdout=log, stderr=log)
        try:
            yield
        finally:
            process.terminate()
            process.wait(30)


@contextlib.contextmanager
def living(system: System, port: int, *, is_shore: bool) -> Iterator[Callable[[], set[str]]]:
    """Publish what this side publishes, and hear the rest; gives the names that were heard."""
    own = [topic for topic in system.topics if topic.is_ordered is is_shore]
    others = [topic for topic in system.topics if topic.is_ordered is not is_shore]
    ended = threading.Event()
    with contextlib.ExitStack() as stack:
        if system is ROS:
            speakers, heard = _ros(stack, port, own, others)
        else:
            speakers, heard = _plain(stack, system, port, own, others)
        threads = [
            threading.Thread(target=_speak, args=(topic, speaker, ended, 0.37 * number))
            for number, (topic, speaker) in enumerate(zip(own, speakers, strict=True))
        ]
        for thread in threads:
            thread.start()
        try:
            yield heard
        finally:
            ended.set()
            for thread in threads:
                thread.join()


def _plain(
    stack: contextlib.ExitStack,
    system: System,
    port: int,
    own: Sequence[Published],
    others: Sequence[Published],
) -> tuple[list[Callable[[Any], None]], Callable[[], set[str]]]:
    heard: set[str] = set()
    session = stack.enter_context(zenoh.open(zenoh_config("client", connect=port)))
    for topic in others:
        session.declare_subscriber(topic.name, lambda sample: heard.add(str(sample.key_expr)))

    def speaker(topic: Published) -> Callable[[Any], None]:
        def say(value: Any) -> None:
            payload, encoding = system.payload(value)
            session.put(topic.name, payload, encoding=encoding)

        return say

    return [speaker(topic) for topic in own], lambda: heard


def _ros(
    stack: contextlib.ExitStack,
    port: int,
    own: Sequence[Published],
    others: Sequence[Published],
) -> tuple[list[Callable[[Any], None]], Callable[[], set[str]]]:
    node = Node(stack.enter_context(ros_session(port)), "autopilot")
    stack.callback(lambda kept: None, node)  # its tokens and subscriptions go with it
    told = {topic.name: node.subscribe(topic.name, topic.interface) for topic in others}
    speakers = [node.publisher(topic.name, topic.interface) for topic in own]
    return speakers, lambda: {name for name, queue in told.items() if not queue.empty()}


def _speak(
    topic: Published, say: Callable[[Any], None], ended: threading.Event, phase_s: float
) -> None:
    """Publish until the end; no two topics in one rhythm."""
    due, count = time.monotonic() + phase_s % topic.every_s, 0
    while not ended.wait(max(0.0, due - time.monotonic())):
        say(topic.value(count))
        due, count = due + topic.every_s, count + 1


def airtime_s(*ports: int) -> float:
    """Return the airtime of the gateways at some routers so far, s."""
    total = 0.0
    for port in ports:
        with zenoh.open(zenoh_config("client", connect=port)) as session:
            replies = [reply.ok for reply in session.get("@acoustic/*/link", timeout=5)]
            documents = [
                json.loads(each.payload.to_bytes()) for each in replies if each is not None
            ]
            total += sum(document["airtime_s"] for document in documents)
    return total


def _router(port: int) -> zenoh.Config:
    settings = zenoh_config("router", listen=port)
    settings.insert_json5("adminspace/enabled", "true")
    return settings


if __name__ == "__main__":
    sys.exit(main())
