from collections.abc import Callable
from typing import Any

import pytest

from zacoustic.channel.scenario import Scenario, scenario_from_mapping


@pytest.fixture
def line() -> Callable[..., Scenario]:
    """Return what makes a scenario of nodes 1, 2, … at places on a line to the east, m."""

    def build(*places_m: float, **settings: Any) -> Scenario:
        nodes = [
            {"address": index + 1, "position": [place, 0, 10]}
            for index, place in enumerate(places_m)
        ]
        return scenario_from_mapping({"nodes": nodes, **settings}, source="test")

    return build
