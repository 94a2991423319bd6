"""Commands survive the sea: each is executed once, in its order, in its time, and told honestly."""

from collections.abc import Callable

import pytest

from tests.virtual.commandscenario import CommandScenario
from tests.virtual.fleet import line
from zacoustic.core.engine.events import ResponseReceived
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.commands import commands
from zacoustic.core.transport.commands.deduplication import DeduplicationTable, Freshness
from zacoustic.testing.virtual import VirtualNetwork

BLOCKS = range(4)


@pytest.mark.parametrize("number", BLOCKS)
def test_all_holds_in_any_scenario(count: Callable[[int], int], number: int) -> None:
    for seed in range(number, count(800), len(BLOCKS)):
        violations = CommandScenario(seed).run()
        assert not violations, f"{len(violations)} complaints, {violations[0]}"


@pytest.mark.parametrize("seed", [230, 335])
def test_request_of_the_present_boot_epoch_is_heard_again_after_a_late_copy(seed: int) -> None:
    # A copy from the epoch before came late, and made the present one count as over. In 335 the
    # node is silent, so that it cannot ask for a proof.
    assert not CommandScenario(seed).run()


def test_scenarios_tell_of_every_outcome() -> None:
    expected = {"answered", "TIMED_OUT", "overtaken by a later order"}
    for seed in range(30):
        drawn = CommandScenario(seed)
        drawn.run()
        expected -= set(drawn.outcomes)
        if not expected:
            return
    raise AssertionError(f"no scenario has {expected}")


# What the scenarios are there to find: they do when it is left out.


def _everything_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DeduplicationTable, "freshness", lambda *arguments: Freshness.NEW)


def _ages_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "_for_the_rest", lambda command, age_s: command)


def _nobody_is_introduced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Handshake, "introduce", lambda self, *arguments: None)


def _many_last_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Silence, "use_grant", lambda self: None)


@pytest.mark.parametrize(
    ("break_it", "expected", "first"),
    [
        (_everything_is_new, "is executed behind", 0),
        (_ages_do_not_count, "lasts beyond", 6),
        (_nobody_is_introduced, "fails although all is calm", 0),
        (_many_last_words, "in a silence", 0),
    ],
)
def test_scenarios_find_what_is_wrong(
    monkeypatch: pytest.MonkeyPatch,
    break_it: Callable[[pytest.MonkeyPatch], None],
    expected: str,
    first: int,
) -> None:
    break_it(monkeypatch)
    for seed in range(first, first + 100):
        if any(expected in line for line in CommandScenario(seed).run()):
            return
    raise AssertionError(f'no scenario reports that something "{expected}"')


def test_who_commands_is_silent_until_the_answer_could_be_there() -> None:
    """A silent node answers once: copies of the order would deafen the one that waits for it."""
    table = StreamTable(nodes={1: "shore", 2: "auv1"})
    medium = VirtualNetwork(line(0.0, 1000.0, channel="none", seed=7), table)
    silence = RemoteCommand(kind=CommandKind.SILENCE, for_s=1800.0)
    medium.apply(1, lambda engine, now: engine.commands.send(2, silence, now, timeout_s=60.0))
    medium.run(until_s=10.0)
    answered = [event for at, event in medium.events if isinstance(event, ResponseReceived)]
    assert len(answered) == 1
