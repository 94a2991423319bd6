"""Modems that are steered: lines of standard input say where they are."""

import asyncio
import io

import pytest

from zacoustic.channel.propagation.position import Position
from zacoustic_evologics.emulator.fleet import EmulatedFleet, scenario_of
from zacoustic_evologics.emulator.serving.moves import follow_moves
from zacoustic_evologics.emulator.serving.running import RunningFleet


class Moves:
    """Keeps what is moved; modem 9 is not there."""

    def __init__(self) -> None:
        self.made: list[tuple[int, Position]] = []

    def move(self, address: int, position: Position) -> None:
        if address == 9:
            raise ValueError("node is 9; nodes: [1, 2]")
        self.made.append((address, position))


async def follow(moves: Moves | RunningFleet, text: bytes) -> None:
    thread = follow_moves(io.BytesIO(text), moves)
    await asyncio.to_thread(thread.join)
    await asyncio.sleep(0)  # what the thread has called for


def test_each_line_moves_a_modem_and_others_are_complained_about(
    capsys: pytest.CaptureFixture[str],
) -> None:
    moves = Moves()
    lines = (
        b'{"address": 2, "position": [1, 2.5, 3]}\n\n',
        b"go!\n",
        b'{"address": 9, "position": [1, 2, 3]}\n',
        b'{"address": 1, "position": [1, 2]}\n',
        b"x" * 100_000 + b"\n",
        b'{"address": 1, "position": [0, 0, 7]}\n{"address": 1, ',
    )
    asyncio.run(follow(moves, b"".join(lines)))
    assert moves.made == [(2, (1.0, 2.5, 3.0)), (1, (0.0, 0.0, 7.0))]
    problems = capsys.readouterr().err.splitlines()
    assert len(problems) == 4
    assert all(each.startswith("--moves: ") and len(each) < 6000 for each in problems)
    assert "nodes: [1, 2]" in problems[1]


def test_sound_goes_where_a_modem_was_told_to_be() -> None:
    fleet = EmulatedFleet(scenario_of(2))

    async def steer() -> None:
        running = RunningFleet(fleet, clock=lambda: 0)
        await follow(running, b'{"address": 2, "position": [1500, 0, 10]}\n')

    asyncio.run(steer())
    with pytest.raises(ValueError, match="nodes"):
        fleet.move(3, (0.0, 0.0, 0.0), 0)
    with pytest.raises(ValueError, match="position"):
        fleet.move(2, (float("nan"), 0.0, 0.0), 0)
    assert fleet.distance_m(1, 2) == pytest.approx(1500.0, abs=0.1)
