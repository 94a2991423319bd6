"""What the tutorial says of distances and of modems is what its files and commands do."""

import math
import re
from typing import Any, Final

import pytest

from tests.pages.blocks import ROOT, blocks_of, commands_of, files_of
from zacoustic.app.cli import parse
from zacoustic.json5 import parse_json5

PAGE: Final = "docs/tutorial.md"


def test_the_vehicle_is_as_far_away_as_the_page_says() -> None:
    text = (ROOT / PAGE).read_text(encoding="utf-8")
    (said_km,) = re.findall(r"Put the\s+vehicle (\d+) km\s+away", text)
    scenario: Any = parse_json5(files_of(PAGE)["far.json5"], source="far.json5")
    ends = [node["position"] for node in scenario["nodes"]]
    assert math.dist(*ends) / 1000 == pytest.approx(float(said_km), rel=0.01)
    (command,) = re.findall(r"`(zacoustic run modems [^`]*far.json5[^`]*)`", text)
    parse(command.split()[1:])


def test_at_sea_whatever_the_tank_has_set_is_set_back() -> None:
    """A modem keeps its source level and gain: a locator without them goes to sea at -20 dB."""
    tank, sea = (settings_of(section) for section in sections_with_gateways())
    assert tank == {(3, 1)}
    assert sea == {(0, 0)}


def sections_with_gateways() -> list[list[str]]:
    """The commands of each section that starts gateways on serial ports."""
    found: dict[int, list[str]] = {}
    for block in blocks_of(PAGE):
        if block.language == "sh":
            commands = [each for each in commands_of(block.text) if "serial:" in each]
            found.setdefault(block.section, []).extend(commands)
    return [commands for commands in found.values() if commands]


def settings_of(commands: list[str]) -> set[tuple[int, int]]:
    """Source level and gain of each locator."""
    locators = [
        locator for each in commands for locator in re.findall(r"'(evologics/[^']*)'", each)
    ]
    assert locators
    found = set()
    for locator in locators:
        settings = dict(each.split("=") for each in locator.partition("#")[2].split("&"))
        found.add((int(settings["source_level"]), int(settings["gain"])))
    return found
