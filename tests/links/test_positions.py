"""Nodes that are steered: lines of standard input, or samples of Zenoh, say where they are."""

import asyncio
import io
import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO, Any

import pytest
import zenoh

from tests.gateway.networks import LIMIT_S, zenoh_config, zenoh_router
from tests.runtime.loop_checks import run
from zacoustic.app.cli import main
from zacoustic.channel.propagation.position import Position
from zacoustic.link import registry
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.verb import Steered
from zacoustic.link.positions import follow_lines
from zacoustic.testing.linkpair import Side
from zacoustic_evologics.emulator import EmulatedFleet, scenario_of


class Moves:
    """Keeps what is moved; modem 9 is not there."""

    def __init__(self) -> None:
        self.made: list[tuple[int, Position]] = []

    def move(self, address: int, position: Position) -> None:
        if address == 9:
            raise ValueError("node is 9; nodes: [1, 2]")
        self.made.append((address, position))


async def follow(moves: Moves | Steered, text: bytes) -> None:
    thread = follow_lines(io.BytesIO(text), moves)
    await asyncio.to_thread(thread.join)
    await asyncio.sleep(0)  # what the thread has called for


def test_each_line_moves_a_modem_and_others_are_complained_about(
    capsys: pytest.CaptureFixture[str],
) -> None:
    moves = Moves()
    lines = (
        b'{"address": 2, "position": [1, 2.5, 3]}\n\n',
        b"go!\n",
        b"come!\n",
        b'{"address": 2, "position": [1, 2.5, 4]}\n',
        b'{"address": 9, "position": [1, 2, 3]}\n',
        b'{"address": 1, "position": [1, 2]}\n',
        b"x" * 100_000 + b"\n",
        b'{"address": 1, "position": [0, 0, 7]}\n{"address": 1, ',
    )
    asyncio.run(follow(moves, b"".join(lines)))
    assert moves.made == [(2, (1.0, 2.5, 3.0)), (2, (1.0, 2.5, 4.0)), (1, (0.0, 0.0, 7.0))]
    problems = capsys.readouterr().err.splitlines()
    assert len(problems) == 2  # once, until a good one follows
    assert all(each.startswith("--positions: ") and len(each) < 400 for each in problems)
    assert "nodes: [1, 2]" in problems[1]


def test_sound_goes_where_a_modem_was_told_to_be() -> None:
    fleet = EmulatedFleet(scenario_of(2))

    async def steer() -> None:
        running = RunningEmulation(fleet, clock=lambda: 0)
        steered = Steered(fleet, running)
        await follow(steered, b'{"address": 2, "position": [1500, 0, 10]}\n')

    asyncio.run(steer())
    with pytest.raises(ValueError, match="nodes"):
        fleet.move(3, (0.0, 0.0, 0.0), 0)
    with pytest.raises(ValueError, match="position"):
        fleet.move(2, (float("nan"), 0.0, 0.0), 0)
    assert fleet.distance_m(1, 2) == pytest.approx(1500.0, abs=0.1)


SCENARIO = """{ profile: "ideal", channel: "none",
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [15, 0, 10] } ] }"""


def test_a_simulator_on_zenoh_says_where_nodes_of_a_medium_are(tmp_path: Path) -> None:
    (tmp_path / "water.json5").write_text(SCENARIO, encoding="utf-8")
    with zenoh_router() as port:
        endpoint = f"tcp/127.0.0.1:{port}"
        words = ["medium", "water.json5", "--listen", "127.0.0.1:0", "--json"]
        words += ["--positions", "zenoh:simulator/*/pose", "--connect", endpoint]
        with (
            zenoh.open(zenoh_config("client", connect=port)) as session,
            subprocess.Popen(
                [sys.executable, "-m", "zacoustic", *words], cwd=tmp_path, text=True,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            ) as process,
        ):  # fmt: skip
            try:
                assert process.stdout is not None
                address = json.loads(process.stdout.readline())["address"]
                publisher = session.declare_publisher("simulator/auv1/pose")
                matched = threading.Event()
                publisher.declare_matching_listener(lambda status: matched.set())
                status: Any = publisher.matching_status  # an object, not the bool of the stub
                assert status.matching or matched.wait(LIMIT_S)
                publisher.put(b"beyond the bottom")
                publisher.put(b'{ "address": 2, "position": [150, 0, 10] }')
                delays = run(delays_until(address, 0.1, process.stdout))
            finally:
                process.terminate()
                error = process.communicate()[1]
    assert delays[-1] == pytest.approx(0.1)
    assert set(delays[:-1]) <= {0.01}
    assert error.startswith("--positions: JSON is malformed")
    assert error.count("\n") == 1


async def delays_until(address: str, wanted_s: float, lines: IO[str]) -> list[float]:
    """Send until sound takes as long as that; return how long it took each time."""
    near, far = (Side(registry.create(f"sim/{address}", at), at) for at in (1, 2))
    await near.open()
    await far.open()
    delays: list[float] = []
    while not delays or delays[-1] != pytest.approx(wanted_s):
        assert len(delays) < 100
        await near.send(b"where are you?")
        await far.hears(b"where are you?")
        while (record := json.loads(lines.readline()))["event"] != "reception":
            pass
        delays.append(record["propagation_s"])
    await near.close()
    await far.close()
    return delays


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (["--positions", "sonar"], 2, "--positions sonar; allowed: -, or zenoh:KEY"),
        (["--positions", "zenoh:a//b"], 2, "--positions zenoh:a//b: "),
        (["--connect", "tcp/127.0.0.1:1"], 2, "--connect without --positions zenoh:KEY"),
        (
            ["--positions", "zenoh:a", "--connect", "tcp/127.0.0.1:1"],
            1,
            "--positions: cannot join tcp/127.0.0.1:1: ",
        ),
    ],
)
@pytest.mark.parametrize("verb", ["medium", "emulate"])
def test_a_source_that_is_none_is_one_line(
    verb: str, words: list[str], code: int, expected: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    path = tmp_path / "water.json5"
    path.write_text(SCENARIO, encoding="utf-8")
    begun = ["medium", str(path)] if verb == "medium" else ["emulate", "evologics"]
    assert main([*begun, "--listen", "127.0.0.1:0", *words]) == code
    told = capsys.readouterr()
    assert expected in told.err
    assert told.err.count("\n") == 1
    assert told.out == ""
