"""What the doctor says of routes and lists of links, from the health report of a gateway."""

from typing import Any

import pytest

from tests.config.test_routes import section
from zacoustic.app.tools.field.doctor.network import Running
from zacoustic.app.tools.field.doctor.running import judge
from zacoustic.config import config_from_mapping

CONFIG = config_from_mapping(section(), source="fleet.json5")
GOOD = {"route": "far", "next_node": 2, "transmissions": 120, "passed_on": 100, "given_up": 1}
BOND = {
    "name": "radio+acoustic", "links": ["radio", "acoustic"], "in_use": "acoustic", "again": 60,
    "frames_transmitted": 200,
    "reach": {"1": {"radio": "down", "acoustic": "up"}, "3": {"radio": "down", "acoustic": "up"}},
}  # fmt: skip


def found(**health: Any) -> list[str]:
    """Return what is found in such documents."""
    running = Running(is_joined=True, health=health, digests=(CONFIG.table.digest.hex(),))
    return [each.what for each in judge(CONFIG, running)]


def test_good_hops_are_no_fault() -> None:
    few = GOOD | {"transmissions": 8, "passed_on": 1}
    assert found(relay={"hops": [GOOD, few]}) == []


@pytest.mark.parametrize(
    "poor",
    [
        {"transmissions": 400},
        {"transmissions": 900, "passed_on": 0, "given_up": 100},
        {"given_up": 11},
    ],
)
def test_the_worst_hop_is_named(poor: dict[str, int]) -> None:
    hop = GOOD | {"next_node": 3} | poor
    (said,) = found(relay={"hops": [GOOD, hop, GOOD]})
    assert said.startswith(f"route far: {hop['transmissions']} transmissions to node 3 for ")


def test_a_route_that_others_have_otherwise() -> None:
    (said,) = found(dropped={"channel": {"relay_route": 12}})
    assert said.startswith("12 frames came of a route that this node's file lacks")


def test_documents_of_another_version_are_no_fault() -> None:
    assert found(relay={"hops": [7, {}, {"transmissions": "many"}]}) == []
    assert found(relay=3, dropped={"channel": []}) == []
    assert found(**{"bond/x": 7, "bond/y": {"links": 3, "in_use": None}, "bond/z": {}}) == []


def test_a_list_of_links_whose_better_link_reaches_nobody() -> None:
    (said,) = found(**{"bond/radio+acoustic": BOND})
    assert said.startswith("list of links radio+acoustic: radio reaches none of 2 nodes, and 60 of")


@pytest.mark.parametrize(
    "good",
    [
        {"again": 5},  # a vehicle that dives
        {"again": 12, "frames_transmitted": 900},
        {"frames_transmitted": 15, "again": 14},  # too soon
        {"reach": {"1": {"radio": "down"}, "3": {"radio": "doubt"}}},
        {"reach": {}},
        {"links": ["radio"]},  # the last one has no next one
    ],
)
def test_a_list_of_links_that_does_its_work(good: dict[str, Any]) -> None:
    assert found(**{"bond/radio+acoustic": BOND | good}) == []


def test_a_list_of_links_of_which_none_is_up() -> None:
    (said,) = found(**{"bond/radio+acoustic": BOND | {"in_use": None}})
    assert said == "list of links radio+acoustic: none of radio, acoustic is up"


def test_a_better_link_that_is_down_is_no_fault_of_its_list() -> None:
    assert found(**{"bond/radio+acoustic": BOND, "link/radio": {"state": "down"}}) == []
