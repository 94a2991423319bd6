"""`zacoustic config show`: a file with its defaults, which is a file again."""

import json
from pathlib import Path

import pytest

from tests.pages.blocks import ROOT
from zacoustic.app.cli import main
from zacoustic.app.tools.fleetfile import read_fleet
from zacoustic.config import config_from_mapping

FILES = sorted(
    str(path.relative_to(ROOT))
    for folder in ("examples", "examples/auv", "zacoustic/app/tools/demo")
    for path in (ROOT / folder).glob("*fleet*.json5")
)


@pytest.mark.parametrize("name", FILES)
def test_what_is_shown_is_a_file_of_the_same_table(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "show", str(ROOT / name), "--address", "1"]) == 0
    section = json.loads(capsys.readouterr().out)["plugins"]["acoustic"]
    shown = config_from_mapping(section, source="shown", folder=(ROOT / name).parent)
    assert shown.table.digest == read_fleet(ROOT / name).table.digest


def test_defaults_and_arguments_are_filled_in_and_passwords_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "fleet.json5"
    path.write_text(
        """{ connect: { endpoints: ["tcp/user:sesame@host:7447"] }, plugins: { acoustic: {
          address: 1, streams: [ { id: 1, topic: "hello" } ] } } }""",
        encoding="utf-8",
    )
    locator = "sim/127.0.0.1:7000#password=sesame"
    words = ["config", "show", str(path), "--address", "3", "--link", locator]
    assert main([*words, "--json"]) == 0
    out = capsys.readouterr().out
    section = json.loads(out)["plugins"]["acoustic"]
    assert section["address"] == 3
    assert section["streams"][0]["depth"] == 1
    assert section["streams"][0]["priority"] == "data"
    assert "sesame" not in out
    assert main(words) == 0
    assert "sesame" not in capsys.readouterr().out
    assert main(["config", "show", str(tmp_path / "absent.json5")]) == 2
