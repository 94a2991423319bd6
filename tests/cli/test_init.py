"""`zacoustic config init` on a live Zenoh network: it writes a file that `check` accepts."""

import contextlib
import json
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import cbor2
import pytest
import zenoh

from zacoustic.app.cli import main
from zacoustic.app.tools.demo.networks import free_ports


@contextlib.contextmanager
def network(*, adminspace: bool = True) -> Iterator[str]:
    """A router on which a vehicle publishes until the end; gives its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    config = zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "router",
                "listen": {"endpoints": [endpoint]},
                "scouting": {"multicast": {"enabled": False}},
                "adminspace": {"enabled": adminspace},
            }
        )
    )
    with zenoh.open(config) as session:
        session.declare_subscriber("auv1/orders", lambda sample: None)
        session.declare_queryable("auv1/arm", lambda query: query.reply_err("not now"))
        with published(session):
            yield endpoint


@contextlib.contextmanager
def published(session: zenoh.Session) -> Iterator[None]:
    """Publish in a thread until the end."""
    ended = threading.Event()
    thread = threading.Thread(target=publish, args=(session, ended))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def publish(session: zenoh.Session, ended: threading.Event) -> None:
    count = 0
    while not ended.wait(0.02):
        nav = {"lat": 43.1, "depth": 10.5, "count": count}
        session.put("auv1/nav", cbor2.dumps(nav), encoding="application/cbor")
        session.put("auv1/status", json.dumps({"ok": True}), encoding="application/json")
        count += 1


def test_a_live_network_becomes_a_file_that_check_accepts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "first.json5"
    with network() as endpoint:
        code = main(
            ["config", "init", "--connect", endpoint, "--listen-s", "0.5", "--output", str(path)]
        )
    assert code == 0
    assert capsys.readouterr().out == ""
    assert main(["config", "check", str(path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    found = {(row["kind"], row["name"], row["type"]) for row in report["streams"]}
    assert found == {
        ("topic", "auv1/nav", "Nav"),
        ("topic", "auv1/status", "Status"),
        ("request", "auv1/arm", None),
        ("response", "auv1/arm", None),
        ("topic", "auv1/orders", None),
    }


def test_both_sides_get_a_file_that_check_accepts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here, there = tmp_path / "auv1.json5", tmp_path / "shore.json5"
    with network() as endpoint:
        words = ["config", "init", "--connect", endpoint, "--listen-s", "0.5"]
        sides = ["--output", str(here), "--peer", str(there), "--peer-listen", "tcp/127.0.0.1:1"]
        links = ["--link", "sim/127.0.0.1:7000", "--peer-link", "sim/127.0.0.1:7000"]
        assert main([*words, *sides, *links]) == 0
    assert "EDIT" not in capsys.readouterr().err
    for path, name, address in ((here, "auv1", 1), (there, "shore", 2)):
        assert main(["config", "check", str(path), "--json"]) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["nodes"][str(address)] == name
        assert any(row["name"] == "auv1/orders" for row in report["streams"])
    assert 'mode: "router"' in there.read_text(encoding="utf-8")


def test_the_traffic_that_was_seen_is_a_scenario_that_plan_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, scenario = tmp_path / "auv1.json5", tmp_path / "runs" / "traffic.json5"
    scenario.parent.mkdir()
    with network() as endpoint:
        words = ["config", "init", "--connect", endpoint, "--listen-s", "0.5"]
        assert main([*words, "--output", str(first), "--traffic", str(scenario)]) == 0
    assert f"zacoustic config plan {scenario}" in capsys.readouterr().err
    text = scenario.read_text(encoding="utf-8")
    assert 'config: "../auv1.json5"' in text
    assert '// nobody published it: { node: 2, topic: "auv1/orders"' in text
    found = re.search(
        r'topic: "auv1/nav", every_s: ([\d.]+), first_s: [\d.]+, value: (.*) },', text
    )
    assert found is not None
    assert 0.01 < float(found[1]) < 0.5  # as often as it was published, not as it may cross
    assert json.loads(found[2]).keys() == {"lat", "depth", "count"}
    assert main(["config", "plan", str(scenario), "--hours", "0.1", "--json"]) in (0, 1)
    streams = {each["name"] for each in json.loads(capsys.readouterr().out)["streams"]}
    assert {"auv1/nav", "auv1/status"} <= streams


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--traffic", "t.json5"], "--traffic; allowed: with --output, the file that it names"),
        (["--interactive"], "--interactive; allowed: on a terminal"),
        (["--peer-address", "1"], "--peer-address 1; allowed: another address"),
        (["--address", "255"], "--address 255; allowed: 1..254"),
    ],
)
def test_arguments_that_contradict_are_refused(
    words: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "init", "--connect", "tcp/127.0.0.1:1", *words]) == 2
    assert error in capsys.readouterr().err


@contextlib.contextmanager
def peers() -> Iterator[str]:
    """Two peers that know each other, without a router; gives the endpoint of the silent one."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"

    def peer(**more: object) -> zenoh.Config:
        scouting = {"multicast": {"enabled": False}}
        return zenoh.Config.from_json5(json.dumps({"mode": "peer", "scouting": scouting, **more}))

    here = {"endpoints": ["tcp/127.0.0.1:0"]}
    with (
        zenoh.open(peer(listen={"endpoints": [endpoint]})),
        zenoh.open(peer(listen=here, connect={"endpoints": [endpoint]})) as session,
        published(session),
    ):
        yield endpoint


def test_peers_without_a_router_are_listened_to_and_joined_as_a_peer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "first.json5"
    with peers() as endpoint:
        words = ["config", "init", "--connect", endpoint, "--listen-s", "1.5"]
        assert main([*words, "--output", str(path)]) == 0
    text = path.read_text(encoding="utf-8")
    assert 'mode: "peer"' in text
    assert f'connect: {{ endpoints: ["{endpoint}"] }}' in text
    assert 'topic: "auv1/nav"' in text
    assert main(["config", "check", str(path)]) == 0


def test_keys_that_no_wildcard_covers_are_heard_by_name(tmp_path: Path) -> None:
    path = tmp_path / "first.json5"
    settings = {"mode": "router", "scouting": {"multicast": {"enabled": False}}}
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    config = zenoh.Config.from_json5(json.dumps(settings | {"listen": {"endpoints": [endpoint]}}))
    ended = threading.Event()

    def speak(session: zenoh.Session) -> None:
        while not ended.wait(0.02):
            session.put("auv1/@cam/state", "on")
            session.put("auv1/mode", "dive")

    with zenoh.open(config) as session:
        thread = threading.Thread(target=speak, args=(session,))
        thread.start()
        keys = ["--key", "**", "--key", "auv1/@cam/**"]
        words = ["config", "init", "--connect", endpoint, "--listen-s", "0.4", *keys]
        try:
            assert main([*words, "--output", str(path)]) == 0
        finally:
            ended.set()
            thread.join()
    text = path.read_text(encoding="utf-8")
    assert 'topic: "auv1/@cam/state"' in text
    assert 'topic: "auv1/mode"' in text


def test_json_tells_what_was_seen_and_the_file(capsys: pytest.CaptureFixture[str]) -> None:
    with network(adminspace=False) as endpoint:
        code = main(
            [
                "config",
                "init",
                "--connect",
                endpoint,
                "--listen-s",
                "0.3",
                "--key",
                "*/nav",
                "--json",
            ]
        )
    assert code == 0
    told = json.loads(capsys.readouterr().out)
    assert [topic["key"] for topic in told["topics"]] == ["auv1/nav"]
    assert told["topics"][0]["rate_hz"] > 1
    assert told["services"] == []
    assert "no admin space" in told["text"]


def test_an_existing_file_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "first.json5"
    path.write_text("precious", encoding="utf-8")
    assert main(["config", "init", "--connect", "tcp/127.0.0.1:1", "--output", str(path)]) == 2
    assert "exists; allowed: a new file" in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:1", "nonsense"])
def test_a_router_that_is_not_there_is_one_line(
    endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "init", "--connect", endpoint, "--listen-s", "0.1"]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"zacoustic config init: no Zenoh router at {endpoint}")
    assert error.count("\n") == 1


def test_a_time_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "init", "--connect", "tcp/127.0.0.1:1", "--listen-s", "0"]) == 2
    assert "--listen-s 0; allowed: above 0" in capsys.readouterr().err
