"""The vehicle as a node of ROS 2: a plain console steers it through gateways with ROS streams."""

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from examples.auv.craft import Craft
from examples.auv.expedition import fleet_text
from examples.auv.messages import (
    ARM,
    GOTO,
    HOLD,
    JOINTS,
    NAV,
    RUDDER,
    STOP,
    TAKE_PHOTO,
    THRUST,
    Arm,
    Hold,
    Mode,
    Setpoint,
    Stop,
    TakePhoto,
    Waypoint,
)
from examples.auv.roswords import FLEET, from_ros, name_in_ros, shore_section, to_ros
from examples.auv.session import open_session
from examples.auv.shore import Answer, Shore
from examples.auv.start import SHORE, START, VEHICLE
from examples.auv.vehicle import Vehicle
from examples.auv.zenohshore import ZenohShore
from tests.gateway.networks import Channel, local_network, run, until
from tests.gateway.rosnode import Node, ros_session
from zacoustic.config import config_from_mapping
from zacoustic.ros.names import stream_name
from zacoustic.ros.tokens import Entity, read_token

FLOAT = "std_msgs/msg/Float64"


def section_of(address: int) -> dict[str, Any]:
    """Return the section of one gateway; the water of the tests measures no ranges."""
    whole = json.loads(fleet_text(address, "tcp/127.0.0.1:0", ros=True))
    section: dict[str, Any] = whole["plugins"]["acoustic"]
    return section | {"ranging": []}


def test_both_networks_have_one_table_and_names_that_ros_takes() -> None:
    tables = [
        config_from_mapping(section_of(address), source="test", address=address).table
        for address in (SHORE, VEHICLE)
    ]
    assert tables[0].digest == tables[1].digest
    for stream in tables[1]:
        assert stream_name(f"/{stream.name}") == stream.name
    assert {name_in_ros(joint) for joint in JOINTS} < {stream.name for stream in tables[1]}


def test_words_cross_as_numbers_and_back() -> None:
    said = {"mode": "hold", "depth": 1.0}
    assert to_ros(NAV, said) == {"mode": 2, "depth": 1.0}
    assert from_ros(NAV, to_ros(NAV, said)) == said
    assert from_ros("auv1/photo", to_ros("auv1/photo", b"png")) == b"png"
    assert [each.value for each in Mode] == [
        from_ros(NAV, {"mode": number})["mode"] for number in range(len(Mode))
    ]


def test_shore_section_is_without_ros_and_relative_to_no_folder() -> None:
    section = shore_section()
    assert not any("ros" in stream for stream in section["streams"])
    assert Path(section["ros"]["packages"]) == FLEET.parent / "interfaces"


class Changes:
    """What threads bring about, for whoever waits on the loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._event = asyncio.Event()

    def tell(self) -> None:
        """Something may be another way now; from any thread."""
        self._loop.call_soon_threadsafe(self._event.set)

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait until something holds."""
        await until(condition, self._event)


class WatchedCraft(Craft):
    """Tells of each of its steps."""

    def __init__(self, changes: Changes) -> None:
        super().__init__(START)
        self._changes = changes

    def advance(self, now_s: float) -> None:
        super().advance(now_s)
        self._changes.tell()


class Dive:
    """Two networks, the vehicle in a thread, and the console's carrier."""

    def __init__(self, craft: WatchedCraft, near: zenoh.Session, port: int, it: Changes) -> None:
        self.craft = craft
        self.shore = Shore()
        self.carrier = ZenohShore(near, self.shore, ros=True, wake=it.tell)
        self.vehicle_port = port
        self.changes = it

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait until something holds that Zenoh's threads, or the vehicle's, bring about."""

        def holds() -> object:
            self.carrier.drain(asyncio.get_running_loop().time())
            return condition()

        await self.changes.until(holds)

    async def answered(self, answer: Answer) -> Answer:
        """Wait for the end of a call."""
        await self.until(lambda: answer.ended)
        return answer


@contextmanager
def vehicle_at(port: int, craft: Craft) -> Iterator[zenoh.Session]:
    """Run the vehicle as a node of ROS."""
    with open_session(f"tcp/127.0.0.1:{port}", stamps=True) as session:
        vehicle = Vehicle(session, craft, ros=True)
        thread = threading.Thread(target=vehicle.run)
        thread.start()
        try:
            yield session
        finally:
            vehicle.end()
            thread.join()


@asynccontextmanager
async def dive() -> AsyncIterator[Dive]:
    water, changes = Channel(), Changes()
    craft = WatchedCraft(changes)
    async with (
        local_network(SHORE, water, section=section_of(SHORE)) as near,
        local_network(VEHICLE, water, section=section_of(VEHICLE)) as far,
    ):
        with vehicle_at(far.port, craft), near.client() as session:
            yield Dive(craft, session, far.port, changes)


def watch_tokens(session: zenoh.Session, node: str, it: Changes) -> set[tuple[Entity, str]]:
    """Return what a node announces, by kind and topic; it grows, and that is told."""
    seen: set[tuple[Entity, str]] = set()

    def see(sample: zenoh.Sample) -> None:
        token = read_token(str(sample.key_expr))
        if token is not None and token.full_node_name == node:
            seen.add((token.kind, token.topic))
            it.tell()

    session.liveliness().declare_subscriber("@ros2_lv/0/**", see, history=True)
    return seen


@pytest.mark.usefixtures("capfd")
def test_a_plain_console_steers_a_vehicle_that_speaks_ros() -> None:
    async def steer() -> None:
        async with dive() as here:
            craft, carrier, shore = here.craft, here.carrier, here.shore
            await here.until(lambda: shore.nav is not None)
            assert shore.nav is not None
            assert shore.nav.mode is Mode.DISARMED
            armed = await here.answered(carrier.call(ARM, Arm(True)))
            assert armed.is_good, armed.text
            refused = await here.answered(carrier.call(ARM, Arm(True)))
            assert refused.text == "armed already"

            carrier.put(THRUST, Setpoint(-15.0))
            carrier.put(RUDDER, Setpoint(0.15))
            await here.until(lambda: craft.controls.thrust_n and craft.controls.rudder_rad)
            assert craft.controls.thrust_n == pytest.approx(-15.0, abs=0.005)
            assert craft.controls.rudder_rad == pytest.approx(0.15, abs=0.005)

            held = await here.answered(carrier.call(HOLD, Hold(True, 10.0, 90.0, 1.5)))
            assert held.is_good, held.text
            goal = carrier.send_goal(Waypoint(60.0, 160.0, 14.0))
            await here.until(lambda: goal.accepted)
            assert craft.mode is Mode.GOTO
            carrier.cancel_goal()
            await here.answered(goal)
            assert "cancel" in goal.text
            taken = await here.answered(carrier.call(TAKE_PHOTO, TakePhoto(1)))
            assert taken.is_good
            await here.until(lambda: shore.photos)
            assert shore.photos[0].startswith(b"\x89PNG")
            carrier.put(STOP, Stop())
            await here.until(lambda: craft.mode is Mode.STOPPED)

    run(steer())


@pytest.mark.usefixtures("capfd")
def test_nodes_of_its_local_network_find_it_as_a_node() -> None:
    async def look() -> None:
        async with dive() as here:
            with ros_session(here.vehicle_port) as session:
                other = Node(session, "pilot")
                seen = watch_tokens(session, "/auv1/vehicle", here.changes)
                action = f"/{GOTO}/_action"
                expected = {
                    (Entity.NODE, ""),
                    (Entity.SUBSCRIPTION, f"/{STOP}"),
                    *((Entity.SUBSCRIPTION, f"/{name_in_ros(each)}") for each in JOINTS),
                    *((Entity.SERVER, f"/{each}") for each in (ARM, HOLD, TAKE_PHOTO)),
                    *((Entity.PUBLISHER, f"/auv1/{each}") for each in ("nav", "status", "photo")),
                    *((Entity.PUBLISHER, f"{action}/{each}") for each in ("feedback", "status")),
                    *(
                        (Entity.SERVER, f"{action}/{each}")
                        for each in ("send_goal", "get_result", "cancel_goal")
                    ),
                }
                await here.until(lambda: seen >= expected)
                assert seen == expected
                # A node of the local network steers it too, without the channel.
                await here.answered(here.carrier.call(ARM, Arm(True)))
                other.publisher(f"/{name_in_ros(THRUST)}", FLOAT)({"data": -31.0})
                await here.until(lambda: here.craft.controls.thrust_n == -31.0)

    run(look())


@pytest.mark.usefixtures("capfd")
def test_it_goes_up_when_its_gateway_has_lost_the_shore_and_waits_when_that_is_back() -> None:
    def section(address: int) -> dict[str, Any]:
        found = section_of(address)
        found["nodes"][0] |= {"heartbeat_s": 1.0, "lost_after_s": 2.5}
        return found

    async def lose() -> None:
        water, changes = Channel(), Changes()
        craft = WatchedCraft(changes)
        async with local_network(VEHICLE, water, section=section(VEHICLE)) as far:
            with vehicle_at(far.port, craft):
                async with local_network(SHORE, water, section=section(SHORE)) as near:
                    with near.client() as session:
                        here = Dive(craft, session, far.port, changes)
                        await here.answered(here.carrier.call(ARM, Arm(True)))
                        held = here.carrier.call(HOLD, Hold(True, 9.0, 0.0, 1.0))
                        await here.answered(held)
                        assert craft.mode is Mode.HOLD
                await changes.until(lambda: craft.mode is Mode.SURFACING)
                async with local_network(SHORE, water, section=section(SHORE)):
                    await changes.until(lambda: craft.mode is Mode.HOLD)

    run(lose())
