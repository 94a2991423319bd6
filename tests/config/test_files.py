"""Files: with the settings of a router or without, and bad ones."""

from pathlib import Path

import pytest

from zacoustic.config import read_config
from zacoustic.errors import ConfigError


def test_file_is_read_with_the_rest_of_zenoh_s_settings(tmp_path: Path) -> None:
    path = tmp_path / "router.json5"
    path.write_text(
        """{ mode: "router",  // ordinary Zenoh
             plugins_loading: { enabled: false },
             plugins: { acoustic: { __required__: false, address: 1,
               streams: [ { id: 10, topic: "auv1/nav", }, ] } } }""",
        encoding="utf-8",
    )
    config = read_config(path)
    assert config.source == str(path)
    assert config.table.by_id(10).name == "auv1/nav"
    assert config.zenoh_config is not None
    assert config.zenoh_config.get_json("mode") == '"router"'
    assert read_config(path, address=5, locator="sim/h:1").address == 5


def test_file_without_router_settings_is_enough(tmp_path: Path) -> None:
    path = tmp_path / "direct.json5"
    path.write_text("{ plugins: { acoustic: { address: 1 } } }", encoding="utf-8")
    assert read_config(path).address == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{ mode: ", r"router\.json5:\d+:\d+: "),
        ("{}", r"router\.json5: no section plugins\.acoustic"),
        ("{ plugins: { acoustic: 3 } }", r"router\.json5: plugins\.acoustic must be object"),
        (
            "{ plugins: { acoustic: { address: 0 } } }",
            r"router\.json5: plugins\.acoustic\.address: 0; allowed: an address, 1\.\.254",
        ),
    ],
)
def test_bad_file_is_one_line_with_its_name(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "router.json5"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        read_config(path)
    assert "\n" not in str(caught.value)


def test_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.json5"):
        read_config(tmp_path / "nowhere.json5")
