"""`zacoustic config check`: the table of a valid file, one line for each mistake."""

import json
from pathlib import Path
from typing import Any

import pytest

from zacoustic.app.cli import main

SECTION: dict[str, Any] = {
    "address": 2,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "links": [{"locator": "sim/127.0.0.1:7000"}],
    "types": [
        {
            "name": "Nav",
            "fields": [
                {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
                {"name": "mode", "type": "enum", "values": ["idle", "survey"]},
            ],
        },
        {"name": "Text", "fields": [{"name": "text", "type": "string"}]},
    ],
    "streams": [
        {"id": 10, "topic": "auv1/nav", "type": "Nav", "publishers": [2], "stamp": "age"},
        {"id": 11, "topic": "fleet/{node}/{part}",
         "wildcards": [{"name": "part", "values": ["a", "b"]}]},
        {"id": 20, "service": "auv1/arm", "request": "Nav", "server": 2, "timeout_s": 30},
    ],
}  # fmt: skip


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    return write(tmp_path, SECTION)


def write(folder: Path, section: dict[str, Any]) -> Path:
    path = folder / "fleet.json5"
    path.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    return path


def changed(path: str, value: object) -> dict[str, Any]:
    """The section with another value at a path such as `streams.0.id`."""
    section: dict[str, Any] = json.loads(json.dumps(SECTION))
    *steps, last = path.split(".")
    place: Any = section
    for step in steps:
        place = place[int(step)] if step.isdigit() else place[step]
    if isinstance(place, list):
        place.insert(int(last), value)
    else:
        place[last] = value
    return section


def test_a_valid_file_is_shown_as_a_table(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(fleet)]) == 0
    written = capsys.readouterr()
    assert written.err == ""
    lines = written.out.splitlines()
    assert lines[0].startswith(f"{fleet}: valid; node 2, auv1; table ")
    row = next(line.split() for line in lines if "auv1/nav" in line)
    # id, age, latitude of 1 to 5 bytes, enum of one
    assert row == [
        "10",
        "topic",
        "auv1/nav",
        "Nav",
        "auv1",
        "all",
        "data",
        "1",
        "4–8",
        "0.239",
        "s",
    ]


def test_json_has_sizes_airtime_and_digest(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(fleet), "--json", "--address", "1"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["address"] == 1
    assert report["mtu_bytes"] == 64
    assert len(bytes.fromhex(report["digest"])) == 4
    nav, fleet_part, request, response = report["streams"]
    assert (nav["smallest_bytes"], nav["largest_bytes"]) == (4, 8)
    assert nav["airtime_s"] == pytest.approx(0.1503 + 8 * 0.011094)
    # id and wildcard; the rest is as large as a frame
    assert (fleet_part["smallest_bytes"], fleet_part["largest_bytes"]) == (2, None)
    assert (request["kind"], request["smallest_bytes"], request["largest_bytes"]) == (
        "request",
        4,
        8,
    )
    assert (response["kind"], response["smallest_bytes"], response["lifespan_s"]) == (
        "response",
        2,
        30,
    )
    assert report["types"][0] == {
        "name": "Nav", "fields": 2, "smallest_bytes": 2, "largest_bytes": 6
    }  # fmt: skip


def test_lost_contact_is_shown_with_what_would_surprise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entry: dict[str, Any] = {"name": "up", "lost_after_s": 600, "of": [1], "call": "auv1/up"}
    section = changed("lost_contact", [entry | {"by": 2}])
    assert main(["config", "check", str(write(tmp_path, section))]) == 0
    written = capsys.readouterr().out
    line = "lost contact up: 600 s without a frame of 1 (shore): call auv1/up"
    assert line in written.splitlines()
    assert "note: lost_contact without a journal: a restart" in written
    assert "note: lost contact up: none of its nodes has a heartbeat_s" in written
    assert "quiet hours" not in written
    section |= {"journal": "state", "heartbeat_s": 60, "quiet": [{"from": "22:00", "to": "22:10"}]}
    assert main(["config", "check", str(write(tmp_path, section))]) == 0
    written = capsys.readouterr().out
    assert "note: lost contact up: quiet hours last 600 s and do not stop the countdown" in written
    assert "without a journal: a restart" not in written
    assert "has a heartbeat_s" not in written
    assert main(["config", "check", str(write(tmp_path, section)), "--address", "1"]) == 0
    assert "lost contact" not in capsys.readouterr().out


def test_topics_of_ros_that_keep_one_message_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = {"type": "std_msgs/msg/Int32", "ros": {}}
    topics = [
        text | {"id": 1, "topic": "/one"},
        text | {"id": 2, "topic": "/ten", "depth": 10},
        text | {"id": 3, "topic": "/latched", "durability": "transient_local"},
        {"id": 4, "topic": "plain"},
    ]
    section = changed("streams", topics) | {"ros": {}}
    assert main(["check", str(write(tmp_path, section))]) == 0
    written = capsys.readouterr().out
    assert "depth 1 (a node's default is 10), streams 1: a newer message replaces" in written
    section["streams"] = topics[1:]
    assert main(["check", str(write(tmp_path, section))]) == 0
    assert "depth 1" not in capsys.readouterr().out


def test_another_modem_gives_another_airtime(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "check", str(fleet), "--json", "--profile", "waterlinked_m64"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["streams"][0]["airtime_s"] == pytest.approx(8 * 0.0625)
    assert report["mtu_bytes"] == 8


def test_what_does_not_fit_a_frame_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = changed("streams.0.type", "Text")
    assert main(["config", "check", str(write(tmp_path, section))]) == 0
    assert "note: stream 10 (auv1/nav), topic: Text has no largest size" in capsys.readouterr().out


def test_what_is_reliable_crosses_in_parts_where_it_fits_no_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = changed("streams.0.type", "Text")
    section["streams"][0]["reliability"] = "reliable"
    assert main(["config", "check", str(write(tmp_path, section))]) == 0
    assert "auv1/nav), topic:" not in capsys.readouterr().out
    numbers = [{"name": f"n{place}", "type": "float64"} for place in range(9)]
    section["types"].append({"name": "Wide", "fields": numbers})
    section["streams"][0]["type"] = "Wide"
    assert (
        main(["config", "check", str(write(tmp_path, section)), "--profile", "waterlinked_m64"])
        == 0
    )
    assert "for it: all of it crosses in parts" in capsys.readouterr().out


def test_it_is_said_where_the_journal_is_and_what_is_forgotten_without(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "check", str(write(tmp_path, SECTION))]) == 0
    line = "no journal, so a restart forgets calls of auv1/arm (one may run twice)"
    assert line in capsys.readouterr().out.splitlines()
    assert main(["config", "check", str(write(tmp_path, SECTION)), "--address", "1"]) == 0
    assert "forgets" not in capsys.readouterr().out, "it serves nothing"
    path = write(tmp_path, {**SECTION, "journal": "state"})
    assert main(["config", "check", str(path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["journal"] == str(tmp_path / "state" / "node-2.sqlite")
    assert report["forgotten"] == ""
    assert main(["config", "check", str(path)]) == 0
    assert f"journal {report['journal']}" in capsys.readouterr().out.splitlines()
    assert not (tmp_path / "state").exists()


def test_journal_whose_folder_cannot_be_made_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("a file")
    assert (
        main(["config", "check", str(write(tmp_path, {**SECTION, "journal": "taken/state"}))]) == 0
    )
    folder = tmp_path / "taken" / "state"
    assert f"note: journal: this user cannot write {folder}" in capsys.readouterr().out


def test_access_that_cannot_work_with_the_modem_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    access = {
        "method": "tdma", "slots": [1], "slot_s": 1.9, "max_range_m": 1500, "clock_error_s": 0.01,
    }  # fmt: skip
    assert main(["config", "check", str(write(tmp_path, changed("links.0.access", access)))]) == 0
    printed = capsys.readouterr().out
    assert "note: with a modem like evologics_s2c_18_34: access.slot_s: 1.9 s; the large" in printed
    assert "note: access: node 2 has no turn in it, so it never transmits" in printed
    sound = access | {"slots": [1, 2], "slot_s": 3.0}
    assert main(["config", "check", str(write(tmp_path, changed("links.0.access", sound)))]) == 0
    assert "access." not in capsys.readouterr().out


@pytest.mark.parametrize("written", [None, "auto"])
def test_what_medium_access_is_chosen_is_said_with_its_reason(
    written: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = changed("links.0.access", written) if written else SECTION
    assert main(["config", "check", str(write(tmp_path, section))]) == 0
    printed = capsys.readouterr().out
    assert (
        'access "auto" is carrier_sense with a modem like evologics_s2c_18_34: the file has no '
        "schedule, and the modem tells when it hears another one\n" in printed
    )


def test_what_medium_access_is_chosen_is_not_said_where_the_file_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = changed("links.0.access", {"method": "aloha"})
    assert main(["config", "check", str(write(tmp_path, section))]) == 0
    assert 'access "auto"' not in capsys.readouterr().out


def test_who_carries_a_topic_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    section = changed("nodes.2", {"address": 3, "name": "glider"})
    section["streams"].append({
        "id": 12, "topic": "auv1/log", "reliability": "reliable", "journal": True,
        "publishers": [2], "subscribers": [1], "carry": {"by": [3], "expires_s": 7200},
    })  # fmt: skip
    by_whom = "note: auv1/log: carried by glider to shore where these are not heard for 300 s"
    for address, words in (
        (2, f"{by_whom}, for up to 2 h"),
        (3, "note: this node carries auv1/log: carry.max_bytes is 5000"),
    ):
        section |= {"address": address, "journal": str(tmp_path / "journal"),
                    "carry": {"max_bytes": 5000}}  # fmt: skip
        assert main(["check", str(write(tmp_path, section))]) == 0
        assert words in capsys.readouterr().out


@pytest.mark.parametrize(
    ("nodes", "more", "is_asked"),
    [
        (5, {}, False),
        (6, {}, True),
        (16, {"agreement": "confirm"}, True),
        (16, {"agreement": "tag"}, False),
        (16, {"security": {"keys": "keys.json"}}, False),
    ],
)
def test_many_nodes_are_asked_to_agree_by_tags(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    nodes: int,
    more: dict[str, Any],
    is_asked: bool,
) -> None:
    fleet = [{"address": each, "name": f"n{each}"} for each in range(1, nodes + 1)]
    main(["config", "check", str(write(tmp_path, {**SECTION, "nodes": fleet, **more}))])
    pairs = f"{nodes * (nodes - 1)} times after a start of all"
    wanted = f"agreement: {nodes} nodes confirm each other's frames by pairs, {pairs}; add "
    assert (wanted + 'agreement: "tag"' in capsys.readouterr().out) == is_asked


def test_frames_for_one_node_ask_for_no_tags(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = [{"address": each, "name": f"n{each}"} for each in range(1, 17)]
    nav = {"id": 10, "topic": "auv1/nav", "type": "Nav", "publishers": [2], "subscribers": [1]}
    path = write(tmp_path, {**SECTION, "nodes": fleet, "streams": [nav]})
    assert main(["config", "check", str(path)]) == 0
    assert "by pairs" not in capsys.readouterr().out


def test_airtimes_are_those_of_the_link_that_is_given(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def told(*arguments: str) -> Any:
        assert main(["config", "check", str(fleet), "--json", *arguments]) == 0
        return json.loads(capsys.readouterr().out)

    slow = "desert/127.0.0.1:4000#bit_rate_bps=100"
    report = told("--link", slow)
    assert (report["profile"], report["unsaid"]) == (slow, "")
    (row, *_) = report["streams"]
    largest = min(row["largest_bytes"] or 64, report["mtu_bytes"])
    assert row["airtime_s"] >= largest * 8 / 100
    named = told("--link", slow, "--profile", "evologics_s2c_18_34")
    assert (named["profile"], named["unsaid"]) == ("evologics_s2c_18_34", "")
    unknown = told("--link", "sim/127.0.0.1:7000")
    assert unknown["profile"] == "evologics_s2c_18_34"
    assert unknown["unsaid"] == "sim/127.0.0.1:7000 reports its bit rate when it is open"
    assert main(["config", "check", str(fleet), "--link", "sim/127.0.0.1:7000"]) == 0
    assert "reports its bit rate when it is open; --profile names" in capsys.readouterr().out


def test_the_files_of_the_demo_are_valid(capsys: pytest.CaptureFixture[str]) -> None:
    fleet = Path(__file__).parents[2] / "zacoustic" / "app" / "tools" / "demo" / "fleet.json5"
    for address in ("1", "2"):
        assert main(["config", "check", str(fleet), "--address", address]) == 0
    assert "note:" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("locator", "what"),
    [("smoke/here", "no link 'smoke'; installed: "), ("sim/127.0.0.1:70000", "port 70000")],
)
def test_a_link_that_is_none_is_refused_with_its_key_after_the_table(
    locator: str, what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, changed("links.0.locator", locator))
    assert main(["config", "check", str(path)]) == 2
    written = capsys.readouterr()
    assert "auv1/nav" in written.out
    assert written.err.count("\n") == 1
    assert f"{path}: plugins.acoustic.links[0].locator: " in written.err
    assert what in written.err
    assert main(["config", "check", str(path), "--link", locator]) == 2
    assert "zacoustic config check: --link: " in capsys.readouterr().err


def test_a_key_file_that_run_refuses_is_refused_here(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = tmp_path / "fleet.key"
    path = write(tmp_path, changed("security", {"key": "fleet.key"}))
    assert main(["config", "check", str(path)]) == 0  # it is not on this computer
    capsys.readouterr()
    key.write_text("no key", encoding="utf-8")
    key.chmod(0o600)
    assert main(["config", "check", str(path)]) == 1
    assert f"{path}: plugins.acoustic.security.key: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "follows"),
    [
        ("{ plugins: { acoustic: {\n  address: 1\n  streams: [] } } }", "streams: []"),
        ('{ plugins: { acoustic: {\n  nodes: [ { name: "a" } ] // all\n  x: 1 } } }', "x: 1"),
        ("{ plugins: { acoustic: { nodes: [ { address: 1 } { address: 2 } ] } } }", "{ address"),
    ],
)
def test_a_missing_comma_is_named(
    text: str, follows: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "fleet.json5"
    path.write_text(text, encoding="utf-8")
    assert main(["config", "check", str(path)]) == 2
    assert f"is a comma missing before {follows}" in capsys.readouterr().err


# Path, what is written there, and what the line must hold: key, value, allowed.
WRONG = [
    ("bogus", 1, ["bogus", "unknown key", "address", "streams"]),
    ("streams.0.prority", "data", ["streams[0].prority", "unknown key", "did you mean"]),
    ("streams.1.id", 10, ["streams[1].id", "10", "auv1/nav"]),
    ("streams.0.id", 176, ["streams[0].id", "176", "1..175"]),
    ("streams.0.id", 0, ["streams[0].id", "0", "1..175"]),
    ("address", 255, ["address", "255", "1 (shore)"]),
    ("streams.0.type", "Nv", ["streams[0].type", "Nv", "Nav"]),
    ("types.0.fields.0.type", "flaot64", ["types[0].fields[0].type", "flaot64", "float64"]),
    ("types.0.fields.0.range", [90, -90], ["types[0].fields[0].range", "low < high"]),
    ("types.0.fields.0.stp", 1, ["types[0].fields[0].stp", "unknown key", "step"]),
    ("streams.0.priority", "urgent", ["streams[0].priority", "urgent", "real_time"]),
    ("streams.0.topic", "/auv1/nav", ["streams[0].topic", "/auv1/nav"]),
    ("streams.0.depth", 0, ["streams[0].depth", "0", "1..65535"]),
    ("streams.0.lifespan_s", -1, ["streams[0].lifespan_s", "-1", "above 0"]),
    ("streams.0.reliability", "relible", ["streams[0].reliability", "relible", "reliable"]),
    ("streams.2.server", 9, ["streams[2].server", "9", "1 (shore)"]),
    ("links.0.wire", "morse", ["links[0].wire", "morse", "native"]),
]  # fmt: skip


@pytest.mark.parametrize(("path", "value", "expected"), WRONG, ids=[each[0] for each in WRONG])
def test_a_wrong_file_is_one_line_with_file_key_value_and_what_is_allowed(
    path: str,
    value: object,
    expected: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = write(tmp_path, changed(path, value))
    assert main(["config", "check", str(file)]) == 2
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.count("\n") == 1
    assert written.err.startswith(f"zacoustic config check: {file}: ")
    for part in expected:
        assert part in written.err


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{ plugins: { acoustic: { address: 1,, } } }", [":1:"]),
        ("{ mode: 'router' }", ["plugins.acoustic", "add plugins"]),
        ("{ moed: 'router', plugins: { acoustic: {} } }", ["moed"]),
    ],
)
def test_a_file_that_is_no_config_is_one_line_with_its_name(
    text: str, expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fleet.json5"
    file.write_text(text, encoding="utf-8")
    assert main(["config", "check", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for part in ("fleet.json5", *expected):
        assert part in error


def test_a_file_that_is_missing_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", "nowhere.json5"]) == 2
    error = capsys.readouterr().err
    assert "nowhere.json5" in error
    assert error.count("\n") == 1


def test_an_unknown_profile_lists_those_there_are(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "check", str(fleet), "--profile", "morse"]) == 2
    assert "evologics_s2c_18_34" in capsys.readouterr().err


def test_what_a_sample_costs_in_bits_is_told_of_packed_and_dense_topics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = changed("streams.0.codec", "packed")
    section["streams"] += [
        {"id": 30, "topic": "auv1/way", "type": "Nav", "codec": "dense"},
        {"id": 31, "topic": "auv1/words", "type": "Text", "codec": "packed"},
    ]
    fleet = write(tmp_path, section)
    assert main(["config", "check", str(fleet), "--json"]) == 0
    rows = {row["stream_id"]: row for row in json.loads(capsys.readouterr().out)["streams"]}
    # 180 000 001 latitudes and two modes are 29 bits, in a dense block two bytes more at most
    assert rows[10]["bits"] == {"smallest": 29, "typical": 29.0, "largest": 29}
    assert rows[30]["bits"] == {"smallest": 1, "typical": None, "largest": 48}
    assert rows[31]["bits"] == {"smallest": 9, "typical": None, "largest": None}
    assert rows[11]["bits"] is rows[20]["bits"] is None
    assert main(["config", "check", str(fleet)]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["30", "auv1/way", "Nav", "1", "?", "48"] in lines
    assert ["31", "auv1/words", "Text", "9", "?", "no", "bound"] in lines


def test_what_is_typical_comes_from_the_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = changed("model", "m.json")
    section["streams"].append({"id": 30, "topic": "auv1/way", "type": "Nav", "codec": "dense"})
    model = {"model": {"streams": {}, "single": 0}, "typical_bits": {"30": 12.5, "31": 1}}
    (tmp_path / "m.json").write_text(json.dumps(model), encoding="utf-8")
    assert main(["config", "check", str(write(tmp_path, section)), "--json"]) == 0
    rows = {row["stream_id"]: row for row in json.loads(capsys.readouterr().out)["streams"]}
    assert rows[30]["bits"]["typical"] == 12.5


BLOB = {"name": "Blob", "fields": [{"name": "b", "type": "uint8", "length": 400}]}


def test_what_can_never_cross_fails_and_says_what_makes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream: dict[str, Any] = {"id": 12, "topic": "map", "type": "Blob", "publishers": [2]}
    section = SECTION | {"types": [*SECTION["types"], BLOB], "streams": [stream]}
    assert main(["config", "check", str(write(tmp_path, section))]) == 1
    told = capsys.readouterr().out
    assert "fails: stream 12 (map), topic: even its smallest record" in told
    assert 'it never crosses (reliability: "reliable" in its stream: then it crosses in parts)' in (
        told
    )
    section = section | {"streams": [stream | {"reliability": "reliable"}]}
    assert main(["config", "check", str(write(tmp_path, section))]) == 0
    assert "fails:" not in capsys.readouterr().out
