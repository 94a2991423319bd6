"""Tables and help on a terminal: a table is parted by columns, an example stays a command."""

import io
import re
import shlex

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.app.cli import main
from zacoustic.app.tools.columns import align, within
from zacoustic.text.helptext import filled

HEADER = ("id", "name", "bytes", "airtime")
ROWS = [("1", "auv1/nav", "12", "0.3 s"), ("20", "auv1/a/longer/name", "7", "0.2 s")]


def test_a_log_has_a_row_in_one_line() -> None:
    whole = align(HEADER, ROWS, right=("id", "bytes"))
    assert whole.splitlines()[0] == "id  name                bytes  airtime"
    with within(38):
        assert align(HEADER, ROWS, right=("id", "bytes")) == whole
    with within(None):
        assert align(HEADER, ROWS, right=("id", "bytes")) == whole


def test_a_table_that_is_too_wide_has_its_further_columns_below() -> None:
    with within(30):
        parted = align(HEADER, ROWS, right=("id", "bytes"))
    assert parted.split("\n") == [
        "id  name                bytes",
        " 1  auv1/nav               12",
        "20  auv1/a/longer/name      7",
        "",
        "id  airtime",
        " 1  0.3 s",
        "20  0.2 s",
    ]
    assert max(map(len, align(HEADER, ROWS).splitlines())) == 38  # outside again


@given(
    st.lists(st.lists(st.text("abé", min_size=1, max_size=30), min_size=4, max_size=4), max_size=4),
    st.integers(1, 90),
)
def test_parts_have_every_cell_once_and_are_as_narrow_as_they_can_be(
    rows: list[list[str]], width: int
) -> None:
    header = ["k", "x", "y", "z"]
    with within(width):
        parts = [part.split("\n") for part in align(header, rows).split("\n\n")]
    assert [name for part in parts for name in part[0].split() if name != "k"] == ["x", "y", "z"]
    for part in parts:
        assert len(part) == len(rows) + 1
        is_narrow = max(map(len, part)) <= width
        assert is_narrow or len(part[0].split()) == 2  # one column beside the first


def test_without_a_terminal_check_prints_as_before_and_on_one_it_fits(
    monkeypatch: pytest.MonkeyPatch, tmp_path: pytest.TempPathFactory
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    file = f"{tmp_path}/f.json5"
    streams = ", ".join(f'{{ id: {each}, topic: "a/b/c/{each}" }}' for each in (1, 2))
    with open(file, "w", encoding="utf-8") as written:
        written.write(f"{{ plugins: {{ acoustic: {{ address: 1, streams: [{streams}] }} }} }}")
    said = []
    for terminal in (io.StringIO(), Terminal()):
        monkeypatch.setattr("sys.stdout", terminal)
        monkeypatch.setenv("COLUMNS", "80")
        assert main(["config", "check", file]) == 0
        said.append(terminal.getvalue())
    tables = [
        [line for line in text.splitlines() if re.match(r" ?id |[12]  ", line)] for text in said
    ]
    assert max(map(len, tables[0])) > 80
    assert max(map(len, tables[1])) <= 80
    assert len(tables[1]) == 2 * len(tables[0])


COMMAND = "zacoustic topic pub auv1/cmd '{ mode: \"survey\" }' --link sim/127.0.0.1:7000 --count 3"


def test_an_example_that_is_too_long_stays_a_command() -> None:
    lines = [*filled(f"  {COMMAND}", 50)]
    assert max(map(len, lines)) <= 50
    assert all(line.endswith(" \\") for line in lines[:-1])
    assert shlex.split("\n".join(lines).replace("\\\n", " ")) == shlex.split(COMMAND)
    assert not any(line.endswith("--link \\") for line in lines)  # an option keeps its value


def test_what_an_example_does_is_said_before_it_where_there_is_no_room() -> None:
    assert [*filled("  run --fast      as it can", 26)] == ["  run --fast  as it can"]
    assert [*filled("  run --fast      as it can", 22)] == ["  # as it can", "  run --fast"]
    assert [*filled("  run      quickly", 40)] == ["  run      quickly"]


def test_prose_is_filled_only_where_it_is_too_wide() -> None:
    text = "one two\nthree\n\nfour five six\nseven"
    assert [*filled(text, 20)] == text.split("\n")
    assert [*filled(text, 10)] == ["one two", "three", "", "four five", "six seven"]
