from typing import Any

import pytest

from tests.links.desert.desert_rig import DesertHarness
from tests.runtime.loop_checks import run
from zacoustic.testing.conformance import CHECKS, Check

CONDITIONS: dict[str, dict[str, Any]] = {
    "mrl-64": {},
    "mrl-512": {"max_read_length": 512},
    "mrl-17": {"max_read_length": 17},
    "rmw_desert": {"framing": "rmw_desert"},
    "rmw_desert-512": {"framing": "rmw_desert", "max_read_length": 512},
}


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: str(check.__name__))
def test_link_keeps_the_contract(condition: str, check: Check) -> None:
    run(check(DesertHarness(**CONDITIONS[condition])), limit_s=60.0)
