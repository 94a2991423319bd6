"""The verb, in a process of its own and by its arguments."""

import argparse
import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from zacoustic.errors import ConfigError
from zacoustic_evologics.emulator.command import EvologicsEmulation

MAIN = """
import argparse, sys
from zacoustic_evologics.emulator.command import EvologicsEmulation
verb = EvologicsEmulation()
parser = argparse.ArgumentParser()
verb.add_arguments(parser)
sys.exit(verb.run(parser.parse_args()))
"""
SCENARIO = """
{ channel: "none", seed: 3,
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 32, position: [300, 0, 10] } ],
  links: [ { from: 1, to: 32, loss: { frame: 0.5 } } ] }
"""


def parse(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    EvologicsEmulation().add_arguments(parser)
    return parser.parse_args(arguments)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_verb_says_where_modems_are_serves_them_and_ends_cleanly(
    tmp_path: Path, number: int
) -> None:
    scenario = tmp_path / "water.json5"
    scenario.write_text(SCENARIO)
    faults = tmp_path / "faults.json5"
    faults.write_text("{ rates: { starred: 1 } }")
    arguments = [
        "--scenario", str(scenario), "--listen", "127.0.0.1:0", "--pty", "--json", "--seed", "5",
        "--faults", str(faults), "--set", "ZX=1", "RI=4", "--time-scale", "20",
        "--firmware", "1.6",
    ]  # fmt: skip
    with subprocess.Popen(
        [sys.executable, "-c", MAIN, *arguments], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        places = [json.loads(process.stdout.readline()) for _ in range(4)]
        assert [place["address"] for place in places] == [1, 1, 32, 32]
        kinds = [place["locator"].partition(":")[0] for place in places]
        assert kinds == ["tcp", "serial"] * 2
        _, host, port = places[2]["locator"].split(":")
        with socket.create_connection((host, int(port)), timeout=10) as client:
            client.sendall(b"AT?AL\nAT?RI\nAT!RI1\nATI0\n")
            with client.makefile("rb") as reader:
                lines = [reader.readline().strip() for _ in range(4)]
                assert lines == [b"32", b"4", b"[*]OK", b"1.6"]
        process.send_signal(number)
        assert process.wait(10) == 0


@pytest.mark.parametrize("form", [(), ("--json",)])
def test_verb_tells_what_is_in_the_medium_and_what_becomes_of_it(form: tuple[str, ...]) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", MAIN, "--listen", "127.0.0.1:0", *form], stdout=subprocess.PIPE,
        text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        first, _ = (process.stdout.readline() for _ in range(2))
        place = json.loads(first)["locator"] if form else first.rpartition("/")[2]
        _, host, port = place.split(":")
        with socket.create_connection((host, int(port)), timeout=10) as client:
            client.sendall(b"AT*SENDIM,5,2,ack,hello\n")
            told = [process.stdout.readline() for _ in range(4)]
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
    if not form:
        texts = [line.partition(" s  ")[2].strip() for line in told]
        assert texts == ["1 sends im, 5 bytes", "1 at 2: im received", "2 sends ack",
                         "2 at 1: ack received"]  # fmt: skip
        return
    sent, heard, answer, answer_heard = map(json.loads, told)
    began_s = sent.pop("at_s")
    assert sent == {
        "event": "emission", "source": 1, "sequence": 0, "service": "im", "destination": 2,
        "frame_bytes": 5, "airtime_s": 0.213082,
    }  # fmt: skip
    assert heard.pop("at_s") - began_s == pytest.approx(0.213082 + heard["propagation_s"])
    assert heard["propagation_s"] == pytest.approx(1 / 3)
    assert heard["snr_db"] > 10
    names = ("event", "source", "sequence", "service", "node", "outcome")
    assert [heard[name] for name in names] == ["reception", 1, 0, "im", 2, "received"]
    assert [answer[name] for name in ("source", "service", "frame_bytes")] == [2, "ack", 0]
    assert [answer_heard[name] for name in names] == ["reception", 2, 0, "ack", 1, "received"]


def test_verb_ends_when_its_reader_has_gone() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", MAIN, "--modems", "2", "--listen", "127.0.0.1:0", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        assert process.stderr is not None
        places = [json.loads(process.stdout.readline())["locator"] for _ in range(2)]
        process.stdout.close()
        _, host, port = places[0].split(":")
        with socket.create_connection((host, int(port)), timeout=10) as client:
            client.sendall(b"AT*SENDIM,5,2,noack,hello\n")
            assert process.wait(10) == 0
        assert process.stderr.read() == ""


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--modems", "0"], "0 modems"),
        (["--modems", "255"], "255 modems"),
        (["--listen", "nowhere"], "allowed: HOST:PORT"),
        (["--modems", "3", "--listen", "127.0.0.1:65534"], "no port for every modem"),
        (["--set", "ZX"], "allowed: NAME=VALUE"),
        (["--set", "QQ=1"], "setting QQ"),
        (["--time-scale", "0"], "time scale"),
    ],
)
def test_wrong_arguments_are_named(arguments: list[str], problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        EvologicsEmulation().run(parse(*arguments))


def test_scenario_may_be_used_in_part(tmp_path: Path) -> None:
    from zacoustic_evologics.emulator.command import _create_fleet
    from zacoustic_evologics.emulator.observation import ignore

    path = tmp_path / "water.json5"
    path.write_text(SCENARIO)
    assert _create_fleet(parse("--scenario", str(path), "--modems", "1"), ignore).addresses == (1,)
    with pytest.raises(ConfigError, match="--modems 3"):
        _create_fleet(parse("--scenario", str(path), "--modems", "3"), ignore)
