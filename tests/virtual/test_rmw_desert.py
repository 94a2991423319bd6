"""Two engines that speak rmw_desert, in virtual time, while everything goes wrong that can."""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.core.rmw_desert.vehicle import ADD, COMMAND, NOTE, SHORE, TWIST, VEHICLE, table
from tests.virtual.fleet import line
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.testing.virtual import Modem, VirtualNetwork

WHOLE = (Modem(), Modem(addressed=False), Modem(addressed=False, framed=False))
"""A packet goes as one frame, and frames have a check."""
PIECES = Modem(addressed=False, framed=False, mtu_bytes=17)
"""A packet goes in pieces. Where one is lost or late the others may look like a packet: there is no
check in it, and nobody can tell."""
HOUR_S = 3600.0


class DesertScenario:
    """One run: what was said, and what was heard."""

    def __init__(self, seed: int, modem: Modem, **scenario: Any) -> None:
        self.dice = random.Random(f"story/{seed}")
        self.calls: dict[int, int] = {}
        """Call id → what is asked."""
        self.ended: dict[int, object] = {}
        """Call id → the sum, or why there is none."""
        self.executed: Counter[int] = Counter()
        self.said: list[str] = []
        self.heard: list[str] = []
        self.medium = VirtualNetwork(
            line(0, 700, **scenario), table(), seed=seed, modem=modem, deliver=self._deliver
        )

    def _deliver(self, address: int, event: Event) -> None:
        match event:
            case SampleReceived(stream_id=stream_id) if stream_id == NOTE:
                self.heard.append(event.value["data"])
            case RequestReceived():
                self.executed[event.value["a"]] += 1
                answer = {"sum": event.value["a"] + event.value["b"]}
                self.medium.at(
                    self.medium.now / 1e9 + self.dice.uniform(0, 5),
                    lambda: self._reply(address, event, answer),
                )
            case ResponseReceived():
                assert event.call_id not in self.ended
                self.ended[event.call_id] = event.value["sum"]
            case CallFailed():
                assert event.call_id not in self.ended
                self.ended[event.call_id] = event.failure
            case _:
                pass

    def _reply(self, address: int, event: RequestReceived, answer: object) -> None:
        if self.medium.is_running(address):
            self.medium.apply(address, lambda engine, now: engine.reply(event.call, answer, now))

    def say(self, text: str) -> None:
        self.said.append(text)
        self.medium.publish(SHORE, NOTE, {"data": text})

    def call(self, number: int) -> None:
        def begin(engine: Engine, now: int) -> int:
            return engine.call(ADD, {"a": number, "b": 1}, now)

        self.calls[self.medium.apply(SHORE, begin)] = number


@pytest.mark.parametrize("modem", [*WHOLE, PIECES])
def test_on_good_medium_everything_arrives_once(modem: Modem) -> None:
    drawn = DesertScenario(1, modem, channel="none")
    for number in range(20):
        drawn.medium.at(number * 60.0, partial(drawn.say, f"{number} " * 12))
        drawn.medium.at(number * 60.0 + 30, partial(drawn.call, number))
    drawn.medium.run()
    assert drawn.heard == drawn.said
    assert drawn.ended == {call_id: number + 1 for call_id, number in drawn.calls.items()}
    assert set(drawn.executed.values()) == {1}
    assert all(drawn.medium.engine(address).is_idle for address in (SHORE, VEHICLE))
    assert drawn.medium.is_quiet


@pytest.mark.parametrize("modem", WHOLE)
def test_what_arrives_was_said_and_what_was_called_ends(
    modem: Modem, count: Callable[[int], int]
) -> None:
    outcomes: Counter[object] = Counter()
    for seed in range(count(400)):
        drawn = DesertScenario(
            seed, modem,
            channel="none",
            loss={"frame": 0.3},
            faults={"duplicate": 0.05, "jitter_s": 0.5},
        )  # fmt: skip
        for number in range(40):
            at_s = drawn.dice.uniform(0, 2 * HOUR_S)
            drawn.medium.at(at_s, partial(drawn.say, f"text {number} " * 5))
            drawn.medium.at(at_s + 60, partial(drawn.call, number))
        drawn.medium.run()
        assert set(drawn.heard) <= set(drawn.said)
        assert set(drawn.ended) == set(drawn.calls)
        for call_id, outcome in drawn.ended.items():
            number = drawn.calls[call_id]
            assert outcome in (number + 1, CallFailure.TIMED_OUT)
            outcomes[outcome is CallFailure.TIMED_OUT] += 1
            assert drawn.executed[number] or outcome is CallFailure.TIMED_OUT
        assert set(drawn.executed.values()) == {1}
        assert drawn.medium.is_quiet
    assert outcomes[True]
    assert outcomes[False]


def test_damage_and_restarts_never_stop_an_engine(count: Callable[[int], int]) -> None:
    """Without a check wrong values do arrive: what is promised is that all goes on."""
    heard = 0
    for seed in range(count(400)):
        modem = Modem(addressed=False, checked=False, framed=seed % 2 == 0)
        drawn = DesertScenario(
            seed, modem,
            channel="none",
            loss={"frame": 0.1},
            faults={
                "corrupt": 0.3,
                "crashes": [{"node": VEHICLE, "at_s": [500, 2000], "restart_after_s": 30}],
            },
        )  # fmt: skip
        for number in range(60):
            at_s = drawn.dice.uniform(0, HOUR_S)
            drawn.medium.at(at_s, partial(drawn.say, f"text {number}"))
            drawn.medium.at(at_s, partial(drawn.call, number))
        drawn.medium.run(until_s=2 * HOUR_S)
        heard += len(set(drawn.heard) & set(drawn.said))
        assert set(drawn.ended) == set(drawn.calls)
        assert drawn.medium.is_quiet
        for stats in drawn.medium.stats():
            assert sum(each.transmitted_bytes for each in stats.ledger()) == (
                stats.bytes_transmitted
            )
    assert heard


def test_a_day_of_silence_costs_nothing() -> None:
    drawn = DesertScenario(1, WHOLE[2], channel="none")
    drawn.medium.run(until_s=24 * HOUR_S)
    assert [stats.frames_transmitted for stats in drawn.medium.stats()] == [0, 0]
    assert drawn.medium.is_quiet


def test_one_seed_is_one_scenario() -> None:
    digests = set()
    for _ in range(2):
        drawn = DesertScenario(5, WHOLE[2], channel="none", loss={"frame": 0.2})
        for number in range(10):
            drawn.medium.at(number, partial(drawn.call, number))
            drawn.medium.publish(SHORE, COMMAND, TWIST)
        drawn.medium.run()
        digests.add(drawn.medium.digest)
    assert len(digests) == 1
