"""What ROS 2 costs on the channel: a command, and an action over water that loses frames."""

import itertools
from collections.abc import Callable
from functools import partial
from typing import Final

import pytest

from tests.virtual.fibonacci import ORDER, Run, network
from tests.virtual.fleet import line
from zacoustic.config import config_from_mapping
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.testing.virtual import VirtualNetwork

SELF_CONTAINED_BYTES: Final = 9
REFERRED_BYTES: Final = 3
ACTION_BYTES: Final = 150
FIX: Final = "sensor_msgs/msg/NavSatFix"


@pytest.mark.parametrize(
    ("codec", "most_bytes"), [("packed", SELF_CONTAINED_BYTES), ("dense", REFERRED_BYTES)]
)
def test_a_steady_command_takes_a_few_bytes(codec: str, most_bytes: int) -> None:
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    steady = {"linear": zero | {"x": 1.25}, "angular": zero | {"z": -0.5}}
    arrived: list[object] = []

    def take(node: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and event.stream_id == 11:
            arrived.append(event.value)

    medium = network(codec, take)
    sizes: list[int] = []

    def note() -> None:
        sizes.append(medium.engine(1).stats.bytes_transmitted)

    for number in range(60):
        medium.at(10 * number, partial(medium.publish, 1, 11, steady))
        # Acknowledgements ride on what the vehicle says anyway.
        medium.at(10 * number + 5, partial(medium.publish, 2, 12, b"log"))
        medium.at(10 * number + 9, note)
    medium.run(until_s=700)
    assert len(arrived) == 60
    assert all(value == steady for value in arrived)
    steps = [after - before for before, after in itertools.pairwise(sizes)]
    assert max(steps[-20:]) <= most_bytes, steps


def test_a_frame_id_that_stays_the_same_crosses_once() -> None:
    frame_id = "gps_antenna_link"
    bounds = [
        {"field": "position_covariance*", "omit": True},
        {"field": "latitude", "range": [-90, 90], "step": 1e-6},
        {"field": "longitude", "range": [-180, 180], "step": 1e-6},
        {"field": "altitude", "range": [-1000, 100], "step": 0.1},
    ]
    constant = {"field": "header.frame_id", "constant": frame_id}
    steady_bytes = {}
    for is_constant in (False, True):
        overlay = {"type": FIX, "fields": bounds + [constant] * is_constant}
        stream = {"id": 13, "topic": "/fix", "type": FIX, "ros": {"stamp": "drop"}}
        stream |= {"codec": "dense", "publishers": [1], "subscribers": [2]}
        log = {"id": 12, "topic": "log", "publishers": [2], "subscribers": [1]}
        section = {
            "address": 1,
            "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
            "overlays": [overlay],
            "streams": [stream, log],
        }
        table = config_from_mapping(section, source="test").table
        medium = VirtualNetwork(line(0.0, 500.0, channel="none"), table, digest=False)
        header = {} if is_constant else {"header": {"frame_id": frame_id}}
        for number in range(60):
            fix = {"latitude": 45 + 1e-5 * number, "longitude": 12.3, "altitude": 1.0}
            value = header | {"status": {"status": 0, "service": 1}} | fix
            medium.at(10 * number, partial(medium.publish, 1, 13, value))
            medium.at(10 * number + 5, partial(medium.publish, 2, 12, b"log"))
        medium.run(until_s=195)
        before_bytes = medium.engine(1).stats.bytes_transmitted
        medium.run(until_s=700)
        samples = medium.samples(2, 13)
        assert len(samples) == 60
        if not is_constant:
            assert all(sample.value["header"]["frame_id"] == frame_id for sample in samples)
        steady_bytes[is_constant] = medium.engine(1).stats.bytes_transmitted - before_bytes
    # About half a byte of each of the last forty, where the text has sixteen.
    assert steady_bytes[False] - steady_bytes[True] <= 24, steady_bytes


def test_an_action_completes_over_medium_that_loses_a_third(count: Callable[[int], int]) -> None:
    sizes = []
    for seed in range(count(2000)):
        run = Run(seed)
        run.check()
        sizes.append(run.bytes_on_link)
    sizes.sort()
    assert sum(sizes) / len(sizes) <= ACTION_BYTES, sizes
    # Where it goes badly some things are said three times.
    assert sizes[-1] <= 2 * ACTION_BYTES, sizes


def test_an_action_between_nodes_that_know_nothing_of_each_other_takes_no_more() -> None:
    run = Run(1, loss=0.0, cold=True)
    run.check()
    assert len(run.fed) == ORDER
    assert run.bytes_on_link <= ACTION_BYTES


def test_an_action_begins_and_completes_over_medium_that_loses_a_third(
    count: Callable[[int], int],
) -> None:
    sizes = []
    for seed in range(count(1000)):
        run = Run(seed, cold=True)
        run.check()
        sizes.append(run.bytes_on_link)
    assert sum(sizes) / len(sizes) <= ACTION_BYTES, sizes
