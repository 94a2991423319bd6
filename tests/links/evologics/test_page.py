"""What docs/links.md says of modems and their emulator is so."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import FaultKind

PAGE = (Path(__file__).parents[3] / "docs" / "links.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("\n## EvoLogics")[2].partition("\n## ")[0]
CLI = (sys.executable, "-m", "zacoustic")


def files(folder: Path) -> None:
    for name, block in re.findall(r"```json5\n// ([\w.]+)\n(.*?)```", SECTION, re.DOTALL):
        (folder / name).write_text(block, encoding="utf-8")


def as_text(value: object) -> str:
    if value is None:
        return "none"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def test_table_of_settings_has_all_of_them_with_their_defaults() -> None:
    table = SECTION.partition("### Settings")[2].partition("###")[0]
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \|", table, re.MULTILINE)
    config = EvologicsConfig()
    expected = [(name, as_text(getattr(config, name))) for name in config.__struct_fields__]
    assert rows == expected


def test_table_of_faults_has_all_kinds() -> None:
    table = SECTION.partition("| kind | at each")[2].partition("\n\n")[0]
    cells = re.findall(r"^\| ([^|]+) \|", table, re.MULTILINE)
    assert {name for cell in cells for name in re.findall(r"`(\w+)`", cell)} == {
        each.value for each in FaultKind
    }


def test_configuration_of_the_page_is_valid(tmp_path: Path) -> None:
    files(tmp_path)
    checked = subprocess.run(
        [*CLI, "check", "bench.json5"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stderr
    assert "link evologics/tcp:192.168.0.147:9200#highest_address=14&deck=true\n" in checked.stdout


def test_wrong_setting_in_a_configuration_says_what_is_allowed(tmp_path: Path) -> None:
    files(tmp_path)
    page = (tmp_path / "bench.json5").read_text(encoding="utf-8")
    (tmp_path / "wrong.json5").write_text(page.replace("deck=true", "service=quick"))
    checked = subprocess.run(
        [*CLI, "check", "wrong.json5"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 2  # a wrong locator is a wrong file
    assert "service is 'quick'; allowed: auto, burst, im, ims, pbm" in checked.stdout


def test_check_says_that_the_link_takes_larger_frames_than_it_reckons_with(tmp_path: Path) -> None:
    files(tmp_path)
    page = (tmp_path / "bench.json5").read_text(encoding="utf-8")
    (tmp_path / "large.json5").write_text(page.replace("deck=true", "mtu=1024"))
    checked = subprocess.run(
        [*CLI, "check", "large.json5"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stderr
    assert "takes frames of up to 347 bytes" in checked.stdout
    assert "at most 347 of 1024 bytes, which take 4.0 s" in checked.stdout


@pytest.mark.parametrize(
    "files_given", ["", "--scenario bay.json5 --faults faults.json5 --set ZX=1 RI=0"]
)
def test_emulator_of_the_page_begins_to_listen(files_given: str, tmp_path: Path) -> None:
    files(tmp_path)
    assert not files_given or files_given.split()[-2] in SECTION
    command = [*CLI, "emulate", "evologics", "--listen", "127.0.0.1:0", "--json"]
    with subprocess.Popen(
        [*command, *files_given.split()], cwd=tmp_path, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        lines = [json.loads(process.stdout.readline()) for _ in range(2)]
        process.terminate()
    assert [each["event"] for each in lines] == ["listening"] * 2
    assert [each["address"] for each in lines] == [1, 2]
