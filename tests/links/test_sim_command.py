import argparse
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.runtime.loop_checks import run
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link import registry
from zacoustic.testing.linkpair import Side

SCENARIO = """
{ // two modems
  profile: "ideal", channel: "none", seed: 3,
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [0, 0, 10] } ] }
"""

# What the command line does with a verb.
MAIN = """
import argparse, sys
from zacoustic.link import registry
verb = registry.commands()["medium"]
parser = argparse.ArgumentParser()
verb.add_arguments(parser)
sys.exit(verb.run(parser.parse_args()))
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "water.json5"
    path.write_text(SCENARIO)
    return path


def start(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *arguments], stdout=subprocess.PIPE, text=True
    )


def parse(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    registry.commands()["medium"].add_arguments(parser)
    return parser.parse_args(arguments)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_medium_serves_reports_in_json_and_ends_cleanly(scenario: Path, number: int) -> None:
    async def exchange(address: str) -> None:
        near, far = (Side(registry.create(f"sim/{address}", at), at) for at in (1, 2))
        await near.open()
        await far.open()
        await near.send(b"over two processes")
        await far.hears(b"over two processes")
        await near.close()
        await far.close()

    with start(str(scenario), "--listen", "127.0.0.1:0", "--seed", "9", "--json") as process:
        assert process.stdout is not None
        listening = json.loads(process.stdout.readline())
        assert listening["event"] == "listening"
        assert (listening["nodes"], listening["seed"]) == ([1, 2], 9)
        run(exchange(listening["address"]))
        process.send_signal(number)
        records: list[dict[str, Any]] = [json.loads(line) for line in process.stdout]
        assert process.wait(10.0) == 0
    events = [record["event"] for record in records]
    assert events == ["attach", "attach", "emission", "reception", "detach", "detach"]
    assert records[3]["outcome"] == "received"
    assert records[2]["frame_bytes"] == 18


def test_medium_ends_when_its_reader_has_gone(scenario: Path) -> None:
    async def attach(address: str) -> None:
        side = Side(registry.create(f"sim/{address}", 1), 1)
        await side.open()  # makes it write a line, to nobody
        await side.close()

    with start(str(scenario), "--listen", "127.0.0.1:0", "--json") as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["address"]
        process.stdout.close()
        run(attach(address))
        assert process.wait(10.0) is not None


def test_output_for_people_says_what_to_type(scenario: Path) -> None:
    with start(str(scenario), "--listen", "127.0.0.1:0") as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("listening at 127.0.0.1:")
        assert "--link sim/127.0.0.1:" in line
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0


def test_wrong_arguments_are_named(scenario: Path, tmp_path: Path) -> None:
    verb = registry.commands()["medium"]
    for listen in ("", "host", ":1", "host:", "host:x", "host:65536"):
        with pytest.raises(ConfigError, match="allowed: HOST:PORT"):
            verb.run(parse(str(scenario), "--listen", listen))
    with pytest.raises(ConfigError, match="time scale is 0"):
        verb.run(parse(str(scenario), "--listen", "127.0.0.1:0", "--time-scale", "0"))
    with pytest.raises(ConfigError, match="No such file"):
        verb.run(parse(str(tmp_path / "none.json5")))
    wrong = tmp_path / "wrong.json5"
    wrong.write_text("{ nodes: [ { adress: 1 } ] }")
    with pytest.raises(ConfigError, match="adress"):
        verb.run(parse(str(wrong)))


def test_port_in_use_is_a_clear_error(scenario: Path) -> None:
    with start(str(scenario), "--listen", "127.0.0.1:0", "--json") as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["address"]
        with pytest.raises(LinkOpenError, match=f"cannot listen at {address}"):
            registry.commands()["medium"].run(parse(str(scenario), "--listen", address))
        os.kill(process.pid, signal.SIGTERM)
        process.wait(10.0)
