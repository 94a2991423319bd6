"""350 runs of whole fleets, each told in a few lines of digest: the oracle of a rebuild.

A rebuild of the engine may not change a byte of what it transmits, nor an instant. A run is drawn
from its seed; its marks are digests of all frames of all nodes so far (instant, node, link if it
has several, destination, bytes), one every `FRAMES_PER_MARK` frames and one at the end. So the
first mark that differs tells where a run has left its way. Events are counted. Names of code,
events and journal entries are not part of the marks.
"""

import contextlib
import functools
import hashlib
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, TextIO

import msgspec
import pytest

import tests.hostile.drive
import tests.virtual.commandscenario
from tests.hostile import foreign
from tests.hostile.crossing import crossed
from tests.hostile.drive import Drive
from tests.hostile.scenario import Hostile, hostile
from tests.oracle import scenes
from tests.virtual.callscenario import CallScenario
from tests.virtual.commandscenario import CommandScenario
from tests.virtual.goalscenario import GoalScenario
from tests.virtual.settling import Settling
from tests.virtual.stopping import Pressing, stop_took_s
from tests.virtual.test_bonds import dive
from tests.virtual.test_polling import NODES as POLLED
from tests.virtual.test_polling import network as polling
from tests.virtual.test_rmw_desert import WHOLE, DesertScenario
from tests.virtual.test_tdma import Fleet
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.tap import EngineCall, Tap
from zacoustic.core.linktypes import Transmission
from zacoustic.testing.scenarios import draw_scenario, run_scenario
from zacoustic.testing.virtual import Modem, VirtualNetwork

FRAMES_PER_MARK: Final = 200
KEPT: Final = Path(__file__).with_name("runs.json")


class Marks(msgspec.Struct, frozen=True):
    """What came of a run."""

    frames: int
    """All that were transmitted."""
    events: int
    """All that the applications were told."""
    digests: tuple[str, ...]
    """Of the frames so far: after each `FRAMES_PER_MARK`, and at the end."""

    def difference(self, other: "Marks") -> str:
        """Tell where another run of the same name differs; empty: nowhere."""
        if self == other:
            return ""
        for place, (mine, its) in enumerate(zip(self.digests, other.digests, strict=False)):
            if mine != its:
                first = place * FRAMES_PER_MARK + 1
                return f"differs between frames {first} and {first + FRAMES_PER_MARK - 1}"
        return (
            f"{self.frames} frames and {self.events} events, here {other.frames} and {other.events}"
        )


class Checker:
    """Makes engines, and takes down what they transmit.

    Args:
        output: Where each frame is written as a line as well, to compare two versions by `diff`.
    """

    def __init__(self, output: TextIO | None = None) -> None:
        self._output = output
        self._hash = hashlib.sha256()
        self._frames = self._events = 0
        self._digests: list[str] = []

    def make(self, **arguments: Any) -> Engine:
        """Return a new engine that is watched."""
        engine = Engine(**arguments)
        life = f"{engine.address}/{engine.epoch}"
        Tap(engine, functools.partial(self._take, life), ("poll_transmit", "poll_event"))
        return engine

    def marks(self) -> Marks:
        """Return what there was."""
        return Marks(self._frames, self._events, (*self._digests, self._digest()))

    def _take(self, life: str, call: EngineCall) -> None:
        if isinstance(call.result, Transmission):
            self._note(life, call.arguments["now"], call.result)
        elif call.name == "poll_event" and call.result is not None:
            self._events += 1

    def _note(self, life: str, now: int, sent: Transmission) -> None:
        link = "" if sent.link == ONE_LINK else f"{sent.link} "
        line = f"{now} {life} → {link}{sent.destination} {sent.frame_bytes.hex()}\n"
        self._hash.update(line.encode())
        self._frames += 1
        if self._output is not None:
            self._output.write(line)
        if self._frames % FRAMES_PER_MARK == 0:
            self._digests.append(self._digest())

    def _digest(self) -> str:
        return self._hash.hexdigest()[:16]


Run = Callable[[int, Checker], object]


def _scenario(seed: int, checker: Checker) -> None:
    run_scenario(draw_scenario(seed), (), build=checker.make)


def _drive(draw: Callable[[int], Hostile], seed: int, checker: Checker) -> None:
    # What foreign fleets say is part of the run, whatever ran before in this process.
    foreign.frames.cache_clear()
    foreign.subscribe_requests.cache_clear()
    Drive(draw(seed)).run()


def _call(seed: int, checker: Checker) -> None:
    CallScenario(seed).run()


def _goal(seed: int, checker: Checker) -> None:
    GoalScenario(seed).run()


def _order(seed: int, checker: Checker) -> None:
    CommandScenario(seed).run()


def _settling(seed: int, checker: Checker) -> None:
    Settling(seed, senses_carrier=seed % 2 == 0).run()


def _photo(seed: int, checker: Checker) -> None:
    """Something that presses beside an object: listen windows, turns, copies."""
    loss = (0.0, 0.2, 0.4)[seed % 3]
    stop_took_s(seed, loss, 2 + seed % 2, tuple(Pressing)[seed % len(Pressing)])


def _tdma(seed: int, checker: Checker) -> None:
    Fleet(seed).talk(10)


def _polling(seed: int, checker: Checker) -> None:
    network = polling(seed, loss=0.2, modem=Modem(addressed=seed % 2 == 0))
    rng = random.Random(seed)
    for node in POLLED:
        for _ in range(20):
            payload = bytes(rng.randrange(50))
            network.at(rng.uniform(0, 900), functools.partial(network.publish, node, 1, payload))
    network.run(until_s=1500)


def _rmw_desert(seed: int, checker: Checker) -> None:
    drawn = DesertScenario(
        seed, WHOLE[seed % len(WHOLE)], channel="none",
        loss={"frame": 0.2}, faults={"duplicate": 0.05, "jitter_s": 0.5},
    )  # fmt: skip
    for number in range(20):
        at_s = drawn.dice.uniform(0, 3600)
        drawn.medium.at(at_s, functools.partial(drawn.say, f"text {number} " * 5))
        drawn.medium.at(at_s + 60, functools.partial(drawn.call, number))
    drawn.medium.run()


def _bond(seed: int, checker: Checker) -> None:
    dive(seed, checker.make)


def _babbler(seed: int, checker: Checker) -> None:
    scenes.babbler(seed)


def _scene(scene: Callable[[int, scenes.Make], None]) -> Run:
    return lambda seed, checker: scene(seed, checker.make)


_KINDS: Final[dict[str, tuple[int, Run]]] = {
    "hostile": (96, functools.partial(_drive, hostile)),
    "story": (60, _scenario),
    "call": (24, _call),
    "goal": (24, _goal),
    "order": (20, _order),
    "settling": (20, _settling),
    "photo": (16, _photo),
    "tdma": (16, _tdma),
    "rmw_desert": (16, _rmw_desert),
    "polling": (8, _polling),
    "crossed": (6, functools.partial(_drive, crossed)),
    "reused": (6, _scene(scenes.reused)),
    "bond": (6, _bond),
    "photos": (6, _scene(scenes.photos)),
    "mixed": (6, _scene(scenes.mixed)),
    "sealed": (6, _scene(scenes.sealed)),
    "route": (4, _scene(scenes.route)),
    "flood": (4, _scene(scenes.flood)),
    "carried": (6, _scene(scenes.carried)),
    "babbler": (6, _babbler),
}

NAMES: Final = tuple(
    f"{kind} {seed}" for kind, (count, _) in _KINDS.items() for seed in range(count)
)
"""Of all runs: kind and seed."""
ONE_OF_EACH: Final = tuple(f"{kind} 1" for kind in _KINDS)
"""What `make test` runs of them; by an odd seed the scenes are sealed."""


def run(name: str, output: TextIO | None = None) -> Marks:
    """Run one of `NAMES`.

    Args:
        name: Which.
        output: Takes a line for each frame.
    """
    kind, _, seed = name.partition(" ")
    checker = Checker(output)
    with _watched(checker):
        _KINDS[kind][1](int(seed), checker)
    return checker.marks()


def kept() -> dict[str, Marks]:
    """Return the marks of all runs as they were."""
    return msgspec.json.decode(KEPT.read_bytes(), type=dict[str, Marks])


@contextlib.contextmanager
def _watched(checker: Checker) -> Iterator[None]:
    """Have the engines of all virtual networks made by the witness."""
    with pytest.MonkeyPatch.context() as patch:
        defaults: dict[str, Any] = VirtualNetwork.__init__.__kwdefaults__  # type: ignore[assignment]
        patch.setitem(defaults, "build", checker.make)
        for module in (tests.virtual.commandscenario, tests.hostile.drive):
            patch.setattr(module, "Engine", checker.make)
        yield
