"""The package `zacoustic_bringup`, with stand-ins for ROS."""

import sys

import pytest

from tests.bringup.rosstandin import modules
from tests.pages.blocks import ROOT

PACKAGE = ROOT / "examples" / "ros2" / "zacoustic_bringup"


@pytest.fixture(autouse=True)
def ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ROS's modules and those of the package importable, for one test."""
    for name, module in modules(str(PACKAGE)).items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name in [each for each in sys.modules if each.partition(".")[0] == "zacoustic_bringup"]:
        monkeypatch.delitem(sys.modules, name)
