"""What a link says of its settings, as somebody else's link may say it."""

import datetime
from typing import Annotated, Literal

import pytest
from msgspec import Meta

from zacoustic.errors import ConfigError
from zacoustic.link import LinkConfig
from zacoustic.link.contract import convert_config


class Declared(LinkConfig, frozen=True, kw_only=True):
    mtu: Annotated[int, Meta(ge=16, le=64)] = 64
    wait_s: Annotated[float, Meta(gt=0, title="seconds")] | None = None
    mode: Literal["fast", "slow"] = "slow"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mode == "fast" and self.mtu > 32:
            raise ValueError(f"mtu is {self.mtu} with mode fast; allowed: 16..32")


class Checked(LinkConfig, frozen=True, kw_only=True):
    """As links were written before fields could declare ranges."""

    mtu: int = 64
    since: datetime.timedelta | None = None

    def __post_init__(self) -> None:
        if not 16 <= self.mtu <= 64:
            raise ValueError(f"mtu is {self.mtu}; allowed: 16..64")


def test_settings_of_a_locator_are_converted() -> None:
    settings = {"mtu": "32", "wait_s": "1.5", "mode": "fast"}
    found = convert_config(Declared, settings, source="x/y")
    assert found == Declared(mtu=32, wait_s=1.5, mode="fast")
    assert convert_config(Checked, {"mtu": "16"}, source="x/y") == Checked(mtu=16)


@pytest.mark.parametrize(
    ("config", "settings", "problem"),
    [
        (Declared, {"mtu": "15"}, "mtu is '15'; allowed: a number, 16..64"),
        (Declared, {"mtu": "many"}, "mtu is 'many'; allowed: a number, 16..64"),
        (Declared, {"wait_s": "nan"}, "wait_s is 'nan'; allowed: seconds, above 0"),
        (Declared, {"mode": "fest"}, "mode is 'fest'; allowed: fast, slow"),
        (Declared, {"mode": "fast"}, "mtu is 64 with mode fast; allowed: 16..32"),
        (Declared, {"mut": "16"}, "unknown setting 'mut'; allowed settings: mtu, wait_s, mode"),
        (Checked, {"mtu": "15"}, "mtu is 15; allowed: 16..64"),
        (Checked, {"mtu": "many"}, "mtu is 'many'; allowed: a whole number"),
        (Checked, {"since": "x"}, "since is 'x'; allowed: Invalid ISO8601 duration"),
    ],
)
def test_wrong_setting_says_what_is_allowed(
    config: type[LinkConfig], settings: dict[str, str], problem: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        convert_config(config, settings, source="x/y")
    assert str(caught.value) == f"x/y: {problem}"


def test_config_that_a_program_makes_is_checked() -> None:
    with pytest.raises(ValueError, match=r"mtu is 15; allowed: a number, 16\.\.64"):
        Declared(mtu=15)
