"""Scenes of single mechanisms for the oracle: what hides below an ordinary link, drawn from a seed.

Each scene takes a seed and a maker of engines. Scenes with an odd seed are sealed, except where the
docstring says otherwise. Nothing is asserted here; the tests that lend the fleets do that.
"""

import random
from collections.abc import Callable
from functools import partial

from tests.virtual.babbling import Setting, Talk, babble
from tests.virtual.lineoffive import BACK, FIX, KEPT, NODES, PLAN, STOP, LineOfFive
from tests.virtual.mule import LOG, MOORING, MULE, PHOTO, SHIP, Voyage
from tests.virtual.sealed import SealedFleet
from tests.virtual.test_carry import quick_table, quickly
from tests.virtual.test_flood import ABORT, ARM, Sea, in_grid, in_line
from tests.virtual.test_objects_order import draw_mixed_scenario
from tests.virtual.test_objects_reused import AUV, SHORE, Photos
from zacoustic.core.base.sizes import SIZES
from zacoustic.core.engine.engine import Engine
from zacoustic.testing import SMALL_SIZES
from zacoustic.testing.scenarios import draw_scenario, run_scenario

Make = Callable[..., Engine]


def photos(seed: int, make: Make) -> None:
    """Large samples whose transfer numbers come again, and crashes of either end and of both.

    Three of four seeds use small number windows.
    """
    rng = random.Random(f"photos {seed}")
    is_small = seed % 4 != 0
    trial = Photos(SMALL_SIZES if is_small else SIZES, make=_sealed(seed, make))
    for _ in range(rng.randrange(2, 9) if is_small else 64):
        trial.publish(150)
        trial.run(40.0)
    for _ in range(5):
        trial.loses = rng.choice((0, 0, 3, 8))
        trial.publish(rng.choice((700, 1500, 3000)))
        trial.publish(rng.choice((20, 300)))
        trial.run(rng.uniform(2.0, 40.0))
        down = rng.choice(((AUV,), (SHORE,), (AUV, SHORE)))
        for node in down:
            trial.network.crash(node)
        trial.run(rng.choice((1.0, 60.0)))
        for node in down:
            trial.network.start(node)
        trial.run(rng.uniform(2.0, 120.0))
    trial.run(3600.0)


def mixed(seed: int, make: Make) -> None:
    """Small and large samples of one stream in random waters; odd: small number windows."""
    build = partial(make, sizes=SMALL_SIZES) if seed % 2 else make
    run_scenario(draw_mixed_scenario(seed), (), build=build)


def reused(seed: int, make: Make) -> None:
    """Every kind of stream in random waters, with small number windows; never sealed."""
    run_scenario(draw_scenario(2000 + seed), (), build=partial(make, sizes=SMALL_SIZES))


def sealed(seed: int, make: Make) -> None:
    """Every kind of stream in random waters, always sealed."""
    run_scenario(draw_scenario(1000 + seed), (), build=SealedFleet(make=make))


def route(seed: int, make: Make) -> None:
    """All streams over three relays, which restart, and so do the ends."""
    rng = random.Random(f"route {seed}")
    line = LineOfFive(rng.choice((None, 0.1, 0.3)), seed=seed, build=_sealed(seed, make))
    until_s = 1800.0
    for stream_id, mean_s in ((FIX, 60.0), (BACK, 90.0), (PLAN, 200.0), (KEPT, 150.0), (STOP, 500)):
        line.every(mean_s, until_s, rng, partial(_publish, line, stream_id))
    line.network.at(rng.uniform(60.0, until_s), partial(line.publish, PLAN, rng.randbytes(1500)))
    for number in range(3):
        line.network.at(rng.uniform(60.0, until_s), partial(line.call, b"arm %d" % number))
        line.network.at(rng.uniform(60.0, until_s), partial(line.send_goal, b"move %d" % number))
    for _ in range(rng.choice((0, 3, 6))):
        node = rng.randint(1, NODES)
        line.network.at(rng.uniform(60.0, until_s), partial(line.network.restart, node))
    line.network.run(until_s=2 * until_s)


def flood(seed: int, make: Make) -> None:
    """Urgent samples, reliable ones and calls that every node passes on, in a line or a grid."""
    rng = random.Random(f"flood {seed}")
    hears, nodes = rng.choice(((in_line, 5), (in_grid, 12)))
    sea = Sea(
        hears, nodes=nodes, loss=rng.choice((0.0, 0.1, 0.3)), seed=seed, build=_sealed(seed, make)
    )
    for number in range(8):
        sea.publish(rng.uniform(30.0, 900.0), b"stop %d" % number)
        sea.publish(rng.uniform(30.0, 900.0), b"abort %d" % number, ABORT)
    call = partial(sea.network.apply, 1, lambda engine, now: engine.call(ARM, b"arm", now))
    for _ in range(2):
        sea.network.at(rng.uniform(60.0, 900.0), call)
    for _ in range(rng.choice((0, 3))):
        node = rng.randint(2, nodes)
        sea.network.at(rng.uniform(60.0, 900.0), partial(sea.network.restart, node))
    sea.network.run(until_s=3600)


def carried(seed: int, make: Make) -> None:
    """Samples of both sizes that a mule brings, while any of the three nodes crashes."""
    rng = random.Random(f"carried {seed}")
    voyage = Voyage(
        seed, loss=rng.choice((0.0, 0.2)), hears=quickly, table=quick_table(),
        copies=rng.choice(((), (15.0,))), build=_sealed(seed, make),
    )  # fmt: skip
    for number in range(20):
        voyage.publish_at(10.0 + 25.0 * number, b"%d" % number, LOG)
    voyage.publish_at(rng.uniform(10.0, 500.0), rng.randbytes(600), PHOTO)
    for _ in range(rng.choice((0, 2, 4))):
        node, at_s = rng.choice((MOORING, MULE, SHIP)), rng.uniform(5.0, 700.0)
        crash = partial(voyage.network.crash, node, reboots=rng.random() < 0.5)
        voyage.network.at(at_s, crash)
        voyage.network.at(at_s + rng.uniform(1.0, 40.0), partial(voyage.network.start, node))
    voyage.network.run(until_s=2400)


def babbler(seed: int) -> None:
    """Emergencies and reports beside a node that talks without pause; never sealed."""
    rng = random.Random(f"babbler {seed}")
    setting = Setting(
        nodes=rng.choice((3, 6)),
        frame_bytes=rng.choice((8, 33, 64)),
        addressed=rng.random() < 0.5,
        senses_carrier=rng.random() < 0.5,
        reliable=rng.random() < 0.5,
        talk=tuple(Talk)[seed % 5],
    )
    babble(seed, setting, emergencies=4)


def _publish(line: LineOfFive, stream_id: int, number: int) -> None:
    line.publish(stream_id, b"%d" % number)


def _sealed(seed: int, make: Make) -> Make:
    return SealedFleet(make=make) if seed % 2 else make
