"""Listen windows: nobody speaks for more than four seconds without a pause."""

import random
from itertools import pairwise

import msgspec

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.access import Listening
from zacoustic.core.wire.access import ANYBODY, Turn

# As the S2C modem: 0.860 s and a gap of 0.090 s for the largest frame.
LINK = LinkCapabilities(
    mtu_bytes=64, bit_rate_bps=8 / 0.011094, preamble_s=0.1503, gap_s=0.0904, propagation_s=1.0
)
LARGEST_NS = LINK.airtime_ns(64)
GAP_NS = 90_400_000
S = NS_PER_S


class Exclusive:
    """An object that has the channel to itself."""

    is_exclusive = True

    def has_fragment(self, now: int) -> bool:
        return False


class Talker:
    """Sends one frame after the other through a `Listening`."""

    def __init__(self, *, backlog_bytes: int = 10**6) -> None:
        self.listening = Listening(LINK)
        self.now = 0
        self.sent: list[tuple[int, int, bytes]] = []
        self.backlog_bytes = backlog_bytes

    def send(self, airtime_ns: int = LARGEST_NS, *, is_urgent: bool = False) -> int:
        """Send as soon as that may be; returns when it started."""
        self.now = self.listening.pauses_until(self.now, self.now, is_urgent=is_urgent)
        said = self.listening.controls(64, self.backlog_bytes.__ge__, self.now)
        self.listening.handle_started(self.now)
        self.sent.append((self.now, self.now + airtime_ns, said))
        self.listening.handle_transmitted(self.now, self.now + airtime_ns)
        self.now += airtime_ns + GAP_NS
        return self.sent[-1][0]

    def longest_run(self) -> int:
        """Longest time with no pause of the length of a window."""
        longest = begun_at = 0
        last_end: int | None = None
        for started_at, ended_at, _ in self.sent:
            if last_end is None or started_at - last_end >= self.listening.pause_ns:
                begun_at = started_at
            longest = max(longest, ended_at - begun_at)
            last_end = ended_at
        return longest


def test_pause_holds_a_short_frame_and_is_long_enough() -> None:
    assert Listening(LINK).pause_ns >= 450_000_000
    janus = LinkCapabilities(mtu_bytes=480, bit_rate_bps=80, preamble_s=1.2)
    assert Listening(janus).pause_ns > janus.airtime_ns(8)


def test_no_run_is_longer_than_four_seconds() -> None:
    talker = Talker()
    for _ in range(100):
        talker.send()
    assert talker.longest_run() <= 4 * S
    # Four frames and a pause again and again: nine tenths of the time are used.
    assert 100 * LARGEST_NS / talker.now > 0.81


def test_no_run_of_frames_of_any_length_is_longer_than_four_seconds() -> None:
    for seed in range(200):
        rng = random.Random(seed)
        talker = Talker(backlog_bytes=rng.choice((0, 10**6)))
        for _ in range(60):
            talker.now += rng.choice((0, 0, 0, rng.randrange(S)))
            talker.send(rng.randrange(LINK.airtime_ns(1), LARGEST_NS + 1))
        assert talker.longest_run() <= 4 * S


def test_exclusive_transfer_and_urgent_frame_do_not_pause() -> None:
    talker = Talker()
    talker.listening.transfers = Exclusive()
    for _ in range(10):
        talker.send()
    assert talker.longest_run() > 9 * S
    talker = Talker()
    for _ in range(4):
        talker.send()
    before = talker.now
    assert talker.send(is_urgent=True) == before


def test_single_frames_and_small_backlogs_announce_nothing() -> None:
    talker = Talker(backlog_bytes=100)
    for _ in range(9):
        talker.send()
    assert all(not said for _, _, said in talker.sent)
    talker = Talker()
    for _ in range(9):
        talker.now += 2 * S
        talker.send()
    assert all(not said for _, _, said in talker.sent)


def test_announced_pauses_are_kept_and_one_announcement_serves_three_runs() -> None:
    talker = Talker()
    for _ in range(200):
        talker.send()
    said_in = [index for index, (_, _, said) in enumerate(talker.sent) if said]
    assert said_in[0] == 1
    assert len(said_in) <= 200 / (4 * 3) + 2
    for index in said_in:
        started_at, _, said = talker.sent[index]
        turn = Turn.decode(said[1:])
        assert turn.node == ANYBODY
        for run in range(3):
            opens_at = started_at + turn.span_ns + run * talker.listening.period_ns
            quiet = [
                (began, ended)
                for began, ended, _ in talker.sent
                if ended > opens_at + S // 20 and began < opens_at + talker.listening.pause_ns
            ]
            # 20 ms at its beginning belong to the rounding of the announcement.
            assert all(
                began >= opens_at + talker.listening.pause_ns - S // 20 for began, _ in quiet
            )


def test_short_frame_is_aimed_into_the_pause_of_the_other() -> None:
    talker = Talker()
    way_ns = S
    listener = Listening(LINK)
    for _ in range(60):
        started_at = talker.send()
        _, ended_at, said = talker.sent[-1]
        heard_at = ended_at + way_ns
        listener.heard_frame(1, ended_at - started_at, heard_at)
        if said:
            listener.heard_pause(1, Turn.decode(said[1:]).span_ns, started_at, way_ns, heard_at)
    checked = 0
    for _, ended_at, _ in talker.sent[8:50]:
        now = ended_at + way_ns + 7
        fresh = Listening(LINK)
        for started_at, sent_until, said in talker.sent:
            if sent_until + way_ns > now:
                break
            fresh.heard_frame(1, sent_until - started_at, sent_until + way_ns)
            if said:
                span_ns = Turn.decode(said[1:]).span_ns
                fresh.heard_pause(1, span_ns, started_at, way_ns, sent_until + way_ns)
        start_at = fresh.invited_at(now)
        assert start_at is not None
        assert now <= start_at <= now + 4.5 * S
        comfort_ns = fresh.comfort_ns(start_at)
        assert comfort_ns is not None
        assert comfort_ns >= LINK.airtime_ns(8)
        arrives_at, leaves_at = start_at + way_ns, start_at + way_ns + comfort_ns
        assert all(ended <= arrives_at or began >= leaves_at for began, ended, _ in talker.sent), (
            now,
            start_at,
        )
        checked += 1
    assert checked > 30


def test_nobody_waits_for_a_node_that_has_fallen_silent() -> None:
    listener = Listening(LINK)
    listener.heard_pause(1, 2 * S, 0, S // 10, S)
    assert listener.invited_at(S) is not None
    assert listener.invited_at(20 * S) is None
    assert listener.comfort_ns(20 * S) is None


def test_who_is_heard_in_the_pause_is_heard_out() -> None:
    talker = Talker()
    for _ in range(4):
        talker.send()
    _, ended_at, _ = talker.sent[-1]
    talker.listening.handle_carrier(True, ended_at + S // 4)
    after = ended_at + talker.listening.pause_ns
    heard_out_at = ended_at + S // 4 + LARGEST_NS
    assert talker.listening.pauses_until(0, after, is_urgent=False) == heard_out_at
    talker.listening.handle_carrier(False, after + 5)
    talker.listening.heard_frame(2, S // 4, after + 5)
    assert talker.listening.pauses_until(0, after + 5, is_urgent=False) == 0


def test_pauses_that_were_told_are_kept_when_frames_are_small() -> None:
    for seed in range(50):
        rng = random.Random(seed)
        talker = Talker(backlog_bytes=0)
        told: int | None = None
        for _ in range(60):
            is_small = rng.random() < 0.3
            talker.now = talker.listening.pauses_until(talker.now, talker.now, is_urgent=False)
            if not is_small and talker.listening.frames_before_pause(talker.now) == 1:
                talker.listening.end_run()
                pause_at = talker.now + LARGEST_NS
                period_ns = talker.listening.period_ns
                late_ns = 0 if told is None else (pause_at - told) % period_ns
                told = pause_at if told is None or 3 * S > late_ns > S // 20 else told
            talker.send(LINK.airtime_ns(6) if is_small else LARGEST_NS)
        assert talker.longest_run() <= 4 * S, seed
        windows = range(told or 0, talker.now, talker.listening.period_ns)
        for opens_at in list(windows)[:2]:
            busy = [
                began
                for began, ended, _ in talker.sent
                if ended > opens_at + S // 10 and began < opens_at + talker.listening.pause_ns - 1
            ]
            assert not busy, (seed, opens_at, busy)


def test_what_is_due_much_later_does_not_make_a_rhythm_forgotten() -> None:
    listener = Listening(LINK)
    listener.heard_pause(1, 2 * S, 0, S // 10, S)
    assert listener.invited_at(1000 * S) is None
    assert listener.invited_at(S) is not None


class Speaker:
    """Sends short frames into the pauses of node 1, which is heard to be in a run."""

    def __init__(self, *, senses_carrier: bool = True) -> None:
        self.listening = Listening(msgspec.structs.replace(LINK, senses_carrier=senses_carrier))
        self.listening.heard_pause(1, 2 * S, 0, S // 10, S)
        self.now = S

    def send(self, size_bytes: int = 9, *, follows: bool = True) -> int:
        """Send as soon as it may be heard; returns when it started."""
        started_at = self.listening.invited_at(self.now, follows=follows)
        assert started_at is not None
        self.listening.handle_started(started_at)
        ended_at = started_at + LINK.airtime_ns(size_bytes)
        self.listening.handle_transmitted(started_at, ended_at)
        self.now = ended_at + GAP_NS
        return started_at


def test_copies_follow_into_the_same_pause_as_long_as_they_are_heard_out() -> None:
    speaker = Speaker()
    started = [speaker.send() for _ in range(12)]
    steps = [after - before for before, after in pairwise(started)]
    # The pause, a frame, and the way there and back: what is for somebody else may come so early.
    most = int((LARGEST_NS + 2 * S) / (LINK.airtime_ns(9) + GAP_NS))
    assert steps[:most] == [LINK.airtime_ns(9) + GAP_NS] * most
    assert max(steps) > S  # the next pause
    assert not speaker.listening.is_heard_out(speaker.now + S)


def test_what_is_no_copy_waits_for_the_next_pause() -> None:
    speaker = Speaker()
    first_at = speaker.send()
    assert speaker.send(follows=False) > first_at + S


def test_no_copy_follows_where_no_carrier_is_sensed() -> None:
    speaker = Speaker(senses_carrier=False)
    first_at = speaker.send()
    assert not speaker.listening.is_heard_out(speaker.now)
    assert speaker.send() > first_at + S


class Pausing:
    """A node that has ended a run and hears what comes."""

    def __init__(self) -> None:
        self.talker = Talker()
        for _ in range(4):
            self.talker.send()
        self.listening = self.talker.listening
        self.pause_at = self.talker.sent[-1][1]
        self.pause_until = self.pause_at + self.listening.pause_ns

    def hear(self, from_ns: int, size_bytes: int = 9, *, understood: bool = False) -> int:
        """Hear a sound, so long after the pause began; returns when it has ended."""
        begun_at = self.pause_at + from_ns
        ended_at = begun_at + LINK.airtime_ns(size_bytes)
        self.listening.handle_carrier(True, begun_at)
        self.listening.handle_carrier(False, ended_at)
        if understood:
            self.listening.heard_frame(2, ended_at - begun_at, ended_at)
        return ended_at

    def silent_until(self, at: int) -> int:
        """Return until when it is silent."""
        return self.listening.pauses_until(at, at, is_urgent=False)


def test_a_copy_is_awaited_behind_a_sound_that_was_not_understood() -> None:
    pausing = Pausing()
    ended_at = pausing.hear(pausing.listening.pause_ns - S // 10)
    awaited_until = pausing.silent_until(ended_at)
    assert ended_at + GAP_NS < awaited_until < ended_at + GAP_NS + S // 5
    # It comes, and is not understood either.
    second_at = awaited_until - S // 20
    pausing.listening.handle_carrier(True, second_at)
    assert pausing.silent_until(second_at + S // 20) > second_at + S // 2
    pausing.listening.handle_carrier(False, second_at + S // 4)
    assert pausing.silent_until(second_at + S // 4) > second_at + S // 4 + GAP_NS
    # The third is.
    third_at = second_at + S // 4 + GAP_NS
    pausing.listening.handle_carrier(True, third_at)
    pausing.listening.handle_carrier(False, third_at + S // 4)
    pausing.listening.heard_frame(2, S // 4, third_at + S // 4)
    assert pausing.silent_until(third_at + S // 4) <= third_at + S // 4


def test_nothing_is_awaited_behind_a_sound_that_was_understood() -> None:
    pausing = Pausing()
    ended_at = pausing.hear(pausing.listening.pause_ns - S // 10, understood=True)
    assert pausing.silent_until(ended_at) == ended_at


def test_a_sound_that_begins_behind_the_pause_is_not_heard_out() -> None:
    pausing = Pausing()
    pausing.listening.handle_carrier(True, pausing.pause_until + 1)
    assert pausing.silent_until(pausing.pause_until + 2) == pausing.pause_until + 2


def test_endless_noise_is_heard_out_for_a_frame_and_the_way_there_and_back() -> None:
    pausing = Pausing()
    from_ns = S // 10
    for _ in range(40):
        from_ns = pausing.hear(from_ns) - pausing.pause_at + GAP_NS
    late_ns = pausing.silent_until(pausing.pause_until) - pausing.pause_until
    assert LARGEST_NS + 2 * S <= late_ns <= LARGEST_NS + 2 * S + LINK.airtime_ns(8)


def test_a_rhythm_is_forgotten_when_a_frame_was_sent_in_its_pause() -> None:
    way_ns = S
    for runs in range(1, 4):
        for into_ns in range(-LARGEST_NS - S, S, S // 10):
            listener = Listening(LINK)
            listener.heard_pause(1, 2 * S, 0, way_ns, way_ns)
            period_ns = listener.period_ns
            for number in range(runs):  # the pauses before are kept
                listener.heard_frame(1, S // 4, way_ns + number * period_ns + S)
            begun_at = 2 * S + (runs - 1) * period_ns + way_ns + into_ns
            ended_at = begun_at + LARGEST_NS
            middle_ns = listener.pause_ns // 2
            listener.heard_frame(1, LARGEST_NS, ended_at)
            is_known = listener.invited_at(ended_at) is not None
            assert is_known is not (into_ns <= middle_ns <= into_ns + LARGEST_NS), into_ns
