"""What a ground station is told equals what the autopilot did: every same, other, same command.

The two engines between an autopilot that keeps a log, and ground stations (`world`). Each ordered
triple of messages, all forms that cross, at each of several paces, by one station, two stations at
one bridge, and two bridges, with each kind of fault.
"""

import itertools
import random
from collections.abc import Callable
from typing import Any, Final

import pytest

from tests.mavlink.messages import VEHICLE, command_int, command_long
from tests.mavlink.world import Effect, Faults, World, problems
from zacoustic.mavlink.dialect import Message

X, Y = (105_000_000, 205_000_000, 5), (-305_000_000, 405_000_000, -7)


def item(form: str, command: int, place: tuple[int, int, int] = (0, 0, 0)) -> Message:
    """A guided MISSION_ITEM or MISSION_ITEM_INT."""
    fields: dict[str, Any] = {f"param{at}": 0.0 for at in range(1, 5)}
    fields |= {"target_system": VEHICLE, "target_component": 1, "seq": 0, "frame": 6}
    north, east, up = place
    if not form.endswith("_INT"):
        fields |= {"x": north / 1e7, "y": east / 1e7, "z": float(up)}
    else:
        fields |= {"x": north, "y": east, "z": float(up)}
    return Message(form, {**fields, "command": command, "current": 2, "autocontinue": 1})


def set_mode(mode: int) -> Message:
    return Message("SET_MODE", {"target_system": VEHICLE, "base_mode": 1, "custom_mode": mode})


def commands() -> list[tuple[Message, Effect]]:
    """Every command in every form, with what it does."""
    simple: list[tuple[int, tuple[float, ...], Effect]] = [
        (400, (1, 0), ("arm", True, False)),
        (400, (0, 0), ("arm", False, False)),
        (400, (0, 21196), ("arm", False, True)),
        (176, (1, 4, 0), ("mode", 4)),
        (176, (1, 19, 0), ("mode", 19)),
        (20, (), ("return",)),
        (21, (), ("land",)),
    ]
    found: list[tuple[Message, Effect]] = []
    for command, parameters, effect in simple:
        found.append((command_long(command, *parameters), effect))
        found.append((command_int(command, *[*parameters, 0, 0, 0, 0][:4], 0, 0, 0), effect))
    found += [(set_mode(mode), ("mode", mode)) for mode in (4, 19)]
    for place in (X, Y):
        north, east, up = place
        of_sea, effect = ("goto", 0, *place), ("goto", 3, *place)  # by MAV_FRAME
        found.append((command_int(192, -1, 1, 0, 0, *place), effect))
        found.append((command_long(192, -1, 1, 0, 0, north / 1e7, east / 1e7, up), of_sea))
        found += [(item(form, 16, place), effect) for form in ("MISSION_ITEM", "MISSION_ITEM_INT")]
    for form in ("MISSION_ITEM", "MISSION_ITEM_INT"):
        found += [(item(form, 20), ("return",)), (item(form, 21), ("land",))]
    return found


COMMANDS: Final = commands()
TRIPLES: Final = [*itertools.permutations(range(len(COMMANDS)), 2)]
PACES: Final = ("at once", "after 2 s", "when answered", "2 s after the answer", "after 20 s")
STATIONS: Final = {"one station": (0,), "two stations": (0, 0), "two bridges": (0, 1)}
FAULTS: Final = {
    "none": Faults(),
    "refusals": Faults(deny=0.4),
    "a slow autopilot": Faults(deny=0.3, progress=0.3, cable_delay_s=4.0),
    "a lossy cable": Faults(deny=0.3, cable_loss=0.3, cable_delay_s=0.5),
    "copies": Faults(deny=0.4, copies=0.5, cable_loss=0.1),
    "a lossy channel": Faults(deny=0.2, call_loss=0.4, call_delay_s=25, report_loss=0.3),
    "late calls": Faults(late=0.4, call_delay_s=10, report_loss=0.2),
    "a restart": Faults(reboots=True, late=0.3, call_delay_s=20),
    "everything": Faults(
        deny=0.2, cable_loss=0.15, cable_delay_s=2.0, copies=0.2, call_loss=0.2,
        call_delay_s=25, late=0.1, report_loss=0.3, reboots=True,
    ),
}  # fmt: skip


def told_otherwise(
    triple: tuple[int, int], pace: str, bridges: tuple[int, ...], faults: Faults, seed: str
) -> list[str]:
    """Give the first command, the second, the first again; return what is not true."""
    world = World(random.Random(seed), faults, bridges)
    world.run(25 + world.rng.uniform(0, 10))  # both sides know each other
    for turn, number in enumerate((triple[0], triple[1], triple[0])):
        message, effect = COMMANDS[number]
        if turn == 2 and message.name == "COMMAND_LONG" and world.rng.random() < 0.3:
            message = Message(message.name, message.fields | {"confirmation": 1})
        # Of two, one gives the first command twice, the other one the other.
        station = world.stations[turn % len(world.stations)]
        given = station.give(message, effect)
        match pace:
            case "at once":
                pass
            case "when answered":
                world.run(world.now_s + 100, lambda given=given: given.told is not None)  # type: ignore[misc]
            case "2 s after the answer":
                world.run(world.now_s + 100, lambda given=given: given.told is not None)  # type: ignore[misc]
                world.run(world.now_s + 2)
            case _:
                world.run(world.now_s + float(pace.split()[1]))
    world.run(world.now_s + (400 if faults.late else 130))
    return problems(world.given, world.autopilot.log, faults)


@pytest.mark.parametrize("faults", FAULTS)
@pytest.mark.parametrize("stations", STATIONS)
@pytest.mark.parametrize("pace", PACES)
def test_a_station_is_told_what_the_autopilot_did(
    pace: str, stations: str, faults: str, count: Callable[[int], int]
) -> None:
    seed = f"{pace}, {stations}, {faults}"
    for triple in random.Random(seed).sample(TRIPLES, count(len(TRIPLES))):
        name = f"{seed}, {triple}"
        assert not told_otherwise(triple, pace, STATIONS[stations], FAULTS[faults], name), name
