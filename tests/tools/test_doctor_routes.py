"""What the doctor says of routes, from the health report of a gateway."""

from typing import Any

import pytest

from tests.config.test_routes import section
from zacoustic.app.tools.field.doctor.network import Running
from zacoustic.app.tools.field.doctor.running import judge
from zacoustic.config import config_from_mapping

CONFIG = config_from_mapping(section(), source="fleet.json5")
GOOD = {"route": "far", "next_node": 2, "transmissions": 120, "passed_on": 100, "given_up": 1}


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
