"""Transmit silence: at once, until its end, over restarts and steps of the wall clock."""

import random
from collections.abc import Callable

import pytest

from tests.core.rig import link
from zacoustic.core.base.journal import BOOT_KEY
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import ClockStateChanged, SilenceChanged
from zacoustic.core.linktypes import LinkState, TransmitOutcome, TransmitReport
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

S = NS_PER_S
HOUR = 3600 * S
NOON = 1_767_268_800 * S  # 2026-01-01 12:00 UTC
TABLE = StreamTable(
    [
        TopicSpec(stream_id=1, name="a", qos=Qos(depth=9)),
        TopicSpec(stream_id=2, name="b", qos=Qos(priority=Priority.REAL_TIME)),
    ]
)


class Life:
    """One life of a node whose link is up; the journal is a dict."""

    def __init__(
        self,
        stored: dict[str, bytes] | None = None,
        *,
        rules: TransmitRules | None = None,
        utc: int | None = NOON,
        error: int | None = 0,
        boot: bytes = b"",
        now: int = 0,
    ) -> None:
        self.stored = {} if stored is None else stored
        self.now = now
        self.events: list[SilenceChanged] = []
        self.doubts: list[str] = []
        self.engine = Engine(
            address=1,
            table=TABLE,
            epoch=1,
            rng=random.Random(1),
            stored=dict(self.stored) | ({BOOT_KEY: boot} if boot else {}),
            rules=rules or TransmitRules(),
        )
        if utc is not None:
            self.tell(utc, error)
        self.engine.handle_link_state(LinkState.UP, now, link())
        self.settle()

    def tell(self, utc: int, error: int | None = 0) -> None:
        self.engine.handle_clock(utc - self.now, error, self.now)
        self.settle()

    def settle(self) -> None:
        while (write := self.engine.poll_journal()) is not None:
            if write.value is None:
                self.stored.pop(write.key, None)
            else:
                self.stored[write.key] = write.value
            self.engine.handle_journal_committed(write.write_id, self.now)
        while (event := self.engine.poll_event()) is not None:
            if isinstance(event, SilenceChanged):
                self.events.append(event)
            elif isinstance(event, ClockStateChanged):
                self.doubts.append(event.doubt)

    def says(self, now: int, *, urgent: bool = False) -> bool:
        """Publish, let time come, and tell whether a frame goes."""
        self.now = now
        self.engine.publish(2 if urgent else 1, b"x", now)
        due_at = self.engine.poll_timeout()
        if due_at is not None and due_at <= now:
            self.engine.handle_timeout(now)
        self.settle()
        sent = self.engine.poll_transmit(now)
        if sent is not None:
            report = TransmitReport(
                transmission_id=sent.transmission_id,
                outcome=TransmitOutcome.SENT,
                started_at=now,
                finished_at=now,
            )
            self.engine.handle_transmit_report(report, now)
        self.settle()
        return sent is not None

    def command(self, now: int, duration_s: float | None = None) -> None:
        self.now = now
        self.engine.silence.begin(now, duration_s=duration_s)
        self.settle()


def test_nothing_goes_from_the_instant_of_the_command_to_its_end_urgent_or_not() -> None:
    life = Life()
    assert life.says(S)
    life.command(2 * S, 1800)
    assert not life.says(2 * S)
    assert not life.says(3 * S, urgent=True)
    assert life.engine.poll_timeout() == 1802 * S
    assert not life.says(1801 * S)
    assert life.says(1802 * S)
    first, last = life.events
    assert (first.is_silent, first.is_commanded, first.ends_at) == (True, True, 1802 * S)
    assert (last.is_silent, last.ends_at) == (False, None)
    assert "silence" not in life.stored


def test_command_without_a_time_holds_until_it_is_resumed() -> None:
    life = Life()
    life.command(S)
    assert not life.says(10**6 * S)
    assert life.engine.poll_timeout() is None
    life.engine.silence.resume(life.now)
    assert life.says(10**6 * S)


def test_steps_of_the_wall_clock_move_nothing_while_the_node_lives() -> None:
    life = Life()
    life.command(S, 100)
    for utc in (NOON + 10**9 * S, 0, NOON):
        life.tell(utc)
        assert not life.says(50 * S)
    assert life.says(101 * S)


def test_command_outlives_a_restart_for_what_is_left_of_it() -> None:
    life = Life()
    life.command(S, 1800)
    after = Life(life.stored, utc=NOON + 601 * S, now=7 * HOUR)
    assert not after.says(7 * HOUR + 1199 * S)
    assert after.says(7 * HOUR + 1200 * S)


def test_command_that_is_over_at_the_restart_is_forgotten() -> None:
    life = Life()
    life.command(S, 1800)
    after = Life(life.stored, utc=NOON + HOUR)
    assert after.says(0)
    assert "silence" not in after.stored


def test_clock_that_went_back_does_not_prolong_it_beyond_its_duration() -> None:
    life = Life()
    life.command(S, 1800)
    after = Life(life.stored, utc=0)
    assert not after.says(1799 * S)
    assert after.says(1800 * S)


def test_without_any_clock_it_begins_anew_after_a_restart() -> None:
    life = Life(utc=None)
    life.command(S, 1800)
    after = Life(life.stored, utc=None, now=50 * S)
    assert not after.says(1849 * S)
    assert after.says(1850 * S)


def test_time_that_is_told_late_counts() -> None:
    life = Life(utc=None)
    life.command(S, 1800)
    life.now = 11 * S
    life.tell(NOON)  # it began 10 s before
    life.settle()
    after = Life(life.stored, utc=None, now=0)
    assert not after.says(5 * S)
    after.now = 10 * S
    after.tell(NOON + 1700 * S)
    assert not after.says(99 * S)
    assert after.says(100 * S)


def test_command_without_a_time_outlives_a_restart() -> None:
    life = Life()
    life.command(S)
    after = Life(life.stored, utc=NOON + HOUR)
    assert not after.says(10**6 * S)


@pytest.mark.parametrize("duration_s", [0.0, -1.0, float("inf"), float("nan")])
def test_duration_that_is_none_is_refused(duration_s: float) -> None:
    with pytest.raises(ValueError, match=r"duration_s is .*; allowed: above 0"):
        Life().engine.silence.begin(0, duration_s=duration_s)


def test_damaged_entry_of_the_journal_is_no_command() -> None:
    assert Life({"silence": b"xyz"}).says(0)


def test_clock_that_was_set_forward_while_the_node_lived_does_not_end_it_at_a_restart() -> None:
    life = Life()
    life.command(S, 3 * 3600)
    life.now = 5 * S
    life.tell(NOON + 4 * HOUR, None)  # by hand: nothing says that it is right
    life.settle()
    after = Life(life.stored, utc=NOON + 4 * HOUR + 10 * S, error=None, now=2 * S)
    assert not after.says(3 * HOUR - 3 * S)
    assert "not known how long" in after.events[0].doubt
    assert after.says(3 * HOUR)


def test_on_the_same_run_of_the_monotonic_clock_it_ends_to_the_instant() -> None:
    for utc, error in (
        (NOON - HOUR, 0),
        (NOON + 9 * HOUR, 0),
        (NOON + 9 * HOUR, None),
        (None, None),
    ):
        life = Life(boot=b"a", now=HOUR)
        life.command(HOUR + S, 1800)
        after = Life(life.stored, utc=utc, error=error, boot=b"a", now=HOUR + 600 * S)
        assert after.events[0].doubt == ""
        assert not after.says(HOUR + 1801 * S - 1)
        assert after.says(HOUR + 1801 * S)


def test_another_run_of_the_monotonic_clock_tells_nothing() -> None:
    life = Life(boot=b"a", now=9 * HOUR)
    life.command(9 * HOUR, 1800)
    after = Life(life.stored, utc=None, boot=b"b", now=9 * HOUR + 1700 * S)
    assert not after.says(9 * HOUR + 3499 * S)
    assert after.says(9 * HOUR + 3500 * S)


def test_time_that_becomes_sure_late_shortens_what_was_left_by_no_more_than_is_certain() -> None:
    life = Life(error=2 * S)
    life.command(0, 1800)
    after = Life(life.stored, utc=NOON + 999 * HOUR, error=None)
    assert not after.says(59 * S)
    after.now = 60 * S
    after.tell(NOON + 1000 * S, 3 * S)  # it began 1000 s ago, 5 s more or less
    assert not after.says(60 * S + 804 * S)
    assert after.says(60 * S + 805 * S)


def test_silence_that_is_restarted_again_and_again_without_a_clock_ends_all_the_same() -> None:
    life = Life(utc=NOON, error=None)
    life.command(0, 1800)
    silent_s = 0
    while silent_s < 7200:
        life.now = 600 * S
        life.tell(NOON, None)
        silent_s += 600
        if life.says(600 * S):
            break
        life = Life(life.stored, utc=NOON, error=None)
    assert silent_s == 1800


def test_it_never_ends_early_whatever_the_clocks_and_the_restarts(
    count: Callable[[int], int],
) -> None:
    """True time is that of the test; what is sure is true, what is not is anything."""
    for seed in range(count(20_000)):
        rng = random.Random(seed)
        true, boots, booted = 0, 0, -rng.randrange(HOUR)
        length = rng.randrange(1, 4 * 3600) * S

        def statement(rng: random.Random = rng) -> tuple[int | None, int | None]:
            match rng.randrange(3):
                case 0:
                    return None, None
                case 1:
                    return rng.randrange(2 * NOON), None
                case _:
                    error = rng.randrange(5 * S)
                    return NOON + true + rng.randint(-error, error), error  # noqa: B023

        def born(stored: dict[str, bytes] | None = None) -> Life:
            utc, error = statement()
            run = b"%d" % boots  # noqa: B023
            return Life(stored, utc=utc, error=error, boot=run, now=true - booted)  # noqa: B023

        life, commanded = born(), False
        while True:
            true += rng.randrange(1, 1800) * S
            now = true - booted
            if not commanded:
                life.command(now, length / S)
                commanded, ends = True, true + length
            match rng.randrange(4):
                case 0:
                    utc, error = statement()
                    life.now = now
                    if utc is not None:
                        life.tell(utc, error)
                case 1:
                    if rng.random() < 0.5:
                        boots, booted = boots + 1, true - rng.randrange(60 * S)
                    life = born(life.stored)
                case _:
                    pass
            if life.says(true - booted, urgent=True):
                break
            assert true < ends + 40 * length + 10 * HOUR, seed
        assert true >= ends, seed


NIGHT = TransmitRules(quiet=(QuietWindow(22 * HOUR, 6 * HOUR), QuietWindow(5 * HOUR, 7 * HOUR)))


def test_quiet_windows_hold_each_day() -> None:
    life = Life(rules=NIGHT)  # 12:00 at 0
    assert life.says(S)
    assert life.says(10 * HOUR - 1)
    for day in (0, 24 * HOUR):
        assert not life.says(day + 10 * HOUR)
        assert life.engine.poll_timeout() == day + 19 * HOUR  # 07:00, when the second one ends
        assert not life.says(day + 19 * HOUR - 1)
        assert life.says(day + 19 * HOUR)
        assert life.says(day + 20 * HOUR)


def test_quiet_windows_follow_the_wall_clock() -> None:
    life = Life(rules=NIGHT)
    assert not life.says(10 * HOUR)
    life.tell(NOON)
    assert life.says(10 * HOUR)


def test_quiet_windows_without_a_clock_keep_silent() -> None:
    life = Life(rules=NIGHT, utc=None)
    assert not life.says(S)
    life.tell(NOON)
    assert life.says(S)


@pytest.mark.parametrize(
    ("utc", "error", "doubt"),
    [
        (8 * HOUR, 0, "UTC is not known: the clock of this computer is not set"),
        (NOON, None, "UTC is not known: nothing keeps the clock of this computer right"),
    ],
)
def test_quiet_windows_with_a_clock_that_is_not_sure_keep_silent_and_say_why(
    utc: int, error: int | None, doubt: str
) -> None:
    life = Life(rules=NIGHT, utc=utc, error=error)
    assert not life.says(S)
    assert life.doubts == [doubt]
    assert life.engine.poll_timeout() == 10 * S  # the host is asked again
    life.now = 10 * S
    life.engine.handle_timeout(10 * S)
    life.tell(NOON)
    assert life.says(10 * S)
    assert life.doubts == [doubt, ""]


def test_quiet_windows_are_longer_by_what_the_clock_may_be_wrong() -> None:
    life = Life(rules=NIGHT, error=60 * S)
    assert life.says(10 * HOUR - 61 * S)
    assert not life.says(10 * HOUR - 60 * S)
    assert not life.says(19 * HOUR + 59 * S)
    assert life.says(19 * HOUR + 60 * S)


def test_time_that_was_sure_outlives_a_restart_at_sea() -> None:
    first = Life(rules=NIGHT, boot=b"a", now=HOUR)
    assert first.says(2 * HOUR)
    # Nothing has kept the clock right since; but it is the same clock.
    after = Life(
        first.stored, rules=NIGHT, utc=NOON + 2 * HOUR, error=None, boot=b"a", now=3 * HOUR
    )
    assert after.says(3 * HOUR)
    assert not after.says(11 * HOUR)
    # It was set meanwhile, and nobody knows whether that was right.
    after = Life(
        first.stored, rules=NIGHT, utc=NOON + 3 * HOUR, error=None, boot=b"a", now=3 * HOUR
    )
    assert not after.says(3 * HOUR)
    assert "the clock has jumped" in after.doubts[0]
    # Another start: nothing is known.
    after = Life(
        first.stored, rules=NIGHT, utc=NOON + 2 * HOUR, error=None, boot=b"b", now=3 * HOUR
    )
    assert not after.says(3 * HOUR)


def test_resuming_does_not_open_a_quiet_window() -> None:
    life = Life(rules=NIGHT)
    life.command(10 * HOUR)
    life.engine.silence.resume(10 * HOUR)
    assert not life.says(10 * HOUR)
    state = life.engine.silence.state(10 * HOUR)
    assert (state.is_silent, state.is_commanded, state.ends_at) == (True, False, 19 * HOUR)
