import argparse
import asyncio
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import IO, Any

import pytest

from tests.runtime.loop_checks import run
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.testing.linkpair import Side
from zacoustic_desert.command import DesertEmulation, _parse_listen
from zacoustic_desert.config import DesertConfig
from zacoustic_desert.link import DesertLink

SCENARIO = """
{ // two nodes in the water of nobody
  profile: "ideal", channel: "none", seed: 3,
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [0, 0, 10] } ] }
"""

# What the command line does with a verb.
MAIN = """
import argparse, sys
from zacoustic_desert.command import DesertEmulation
verb = DesertEmulation()
parser = argparse.ArgumentParser()
verb.add_arguments(parser)
sys.exit(verb.run(parser.parse_args()))
"""
FAST = ("--listen", "127.0.0.1:0", "--period", "0.01", "--no-csma", "--time-scale", "10")


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "water.json5"
    path.write_text(SCENARIO)
    return path


def start(*arguments: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-c", MAIN, *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def parse(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    DesertEmulation().add_arguments(parser)
    return parser.parse_args(arguments)


async def exchange(addresses: list[str], lines: IO[str]) -> list[dict[str, Any]]:
    """Send one frame once the emulation says that both programs are there.

    TCP is open before the emulation has taken the program on: a frame that arrives between the two
    is heard by nobody, as in the water.
    """
    config = DesertConfig(period_s=0.005, listen_s=0.0)
    near, far = (Side(DesertLink(each, config), at + 1) for at, each in enumerate(addresses))
    await near.open()
    await far.open()
    clients = [json.loads(await asyncio.to_thread(lines.readline)) for _ in addresses]
    await near.send(b"over two processes")
    await far.hears(b"over two processes")
    await near.close()
    await far.close()
    return clients


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("has_scenario", [False, True])
def test_emulation_serves_reports_in_json_and_ends_cleanly(
    scenario: Path, number: int, has_scenario: bool
) -> None:
    more = ("--scenario", str(scenario), "--seed", "9") if has_scenario else ("--modems", "2")
    with start(*FAST, *more, "--json") as process:
        assert process.stdout is not None
        listening = json.loads(process.stdout.readline())
        assert listening["event"] == "listening"
        clients = run(exchange(listening["addresses"], process.stdout))
        assert [client["event"] for client in clients] == ["client", "client"]
        process.send_signal(number)
        records: list[dict[str, Any]] = [json.loads(line) for line in process.stdout]
        assert process.wait(10.0) == 0
    packet = [record for record in records if record["size_bytes"]]
    assert [record["event"] for record in packet] == ["read", "sent", "delivered"]
    assert {record["size_bytes"] for record in packet} == {18}


def test_emulation_ends_when_its_reader_has_gone() -> None:
    with start(*FAST, "--json") as process:
        assert process.stdout is not None
        addresses = json.loads(process.stdout.readline())["addresses"]
        process.stdout.close()

        async def attach() -> None:
            side = Side(DesertLink(addresses[0]), 1)
            await side.open()  # makes it write a line, to nobody
            await side.close()

        run(attach())
        assert process.wait(10.0) == 0


def test_output_for_people_says_what_to_type() -> None:
    with start(*FAST, "--modems", "4", "--paired") as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("stands in for DESERT with 4 nodes: --link desert/127.0.0.1:")
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0


WRONG = [
    (("--modems", "1"), r"--modems is 1; allowed: 2\.\.254"),
    (("--modems", "3", "--paired"), "3 nodes cannot be paired"),
    (("--loss", "1.5"), "loss is 1.5"),
    (("--period", "0"), "period_s is 0"),
    (("--max-read-length", "5000"), "max_read_length is 5000"),
    (("--time-scale", "0"), "time scale is 0"),
    (("--start-delay", "-1"), "--start-delay is -1"),
    (("--listen", "host"), "allowed: HOST:PORT"),
    (("--listen", "h:65535"), "2 ports from 65535"),
    (("--listen", "h:1", "--listen", "h:2", "--listen", "h:3"), "is given 3 times"),
    (("--listen", "h:1", "--listen", "g:2"), "with one host"),
]


@pytest.mark.parametrize(("arguments", "message"), WRONG)
def test_wrong_arguments_are_named(arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        DesertEmulation().run(parse(*arguments))


def test_wrong_scenarios_are_named(scenario: Path, tmp_path: Path) -> None:
    def emulate(*arguments: str) -> None:
        DesertEmulation().run(parse("--listen", "127.0.0.1:0", *arguments))

    with pytest.raises(ConfigError, match="No such file"):
        emulate("--scenario", str(tmp_path / "none.json5"))
    with pytest.raises(ConfigError, match="has 2 nodes"):
        emulate("--scenario", str(scenario), "--modems", "3")
    with pytest.raises(ConfigError, match="--loss beside --scenario"):
        emulate("--scenario", str(scenario), "--loss", "0.1")
    with pytest.raises(ConfigError, match="takes 512 bytes"):
        emulate("--scenario", str(scenario), "--max-read-length", "513")


def test_ports_follow_the_first_or_are_all_given() -> None:
    assert _parse_listen(None, 3) == ("127.0.0.1", [4000, 4001, 4002])
    assert _parse_listen(["[::1]:0"], 2) == ("::1", [0, 0])
    assert _parse_listen(["h:4000", "h:5000"], 2) == ("h", [4000, 5000])


def test_port_in_use_is_a_clear_error() -> None:
    with start(*FAST, "--json") as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["addresses"][0]
        with pytest.raises(LinkOpenError, match=f"cannot listen at {address}"):
            DesertEmulation().run(parse("--listen", address, "--listen", "127.0.0.1:0"))
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0
