"""Lost contact: when a node must act, once per loss, and whatever happens to it meanwhile."""

import random

import msgspec
import pytest

from tests.core.rig import End, link
from zacoustic.core.base.journal import BOOT_KEY, DOUBT_KEY
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import ContactLost, ContactRestored
from zacoustic.core.engine.tap import EngineCall, Tap, call_engine
from zacoustic.core.linktypes import LinkState
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.peers.lostcontact import ContactPhase, LostContactRule
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

AFTER_S = 160.0
NAME = "surface"


def fleet(nodes: int = 3) -> StreamTable:
    named = {address: f"n{address}" for address in range(1, nodes + 1)}
    return StreamTable([TopicSpec(stream_id=10, name="all")], nodes=named)


def rules(*nodes: int, after_s: float = AFTER_S, name: str = NAME) -> TransmitRules:
    rule = LostContactRule(name=name, nodes=nodes, lost_after_s=after_s)
    return TransmitRules(contact=ContactRules(lost_contact=(rule,)))


def start(
    journal: dict[str, bytes],
    now_s: float,
    *,
    boot: bytes = b"one",
    of: TransmitRules | None = None,
) -> End:
    """Start node 3, whose journal is `journal` plus the name of this run of the clock."""
    return End(3, fleet(), journal=journal | {BOOT_KEY: boot}, rules=of or rules(1), now=ns(now_s))


def ns(seconds: float) -> int:
    return round(seconds * NS_PER_S)


def run(end: End, until_s: float) -> None:
    """Let the timers of an end fire until an instant, in seconds."""
    while (due := end.engine.poll_timeout()) is not None and due <= ns(until_s):
        end.now = max(end.now, due)
        end.engine.handle_timeout(end.now)
        end.settle()
    end.now = ns(until_s)


def hear(end: End, source: int, at_s: float) -> None:
    """Bring a heartbeat of a node."""
    end.hear(b"\x00", ns(at_s), source=source)


def phase(end: End) -> ContactPhase:
    (countdown,) = end.engine.lost_contact.countdowns()
    return countdown.phase


def test_nothing_is_armed_or_journalled_without_a_rule() -> None:
    end = End(3, fleet(), journal={BOOT_KEY: b"one"})
    hear(end, 1, 5)
    assert end.engine.poll_timeout() is None
    assert not [key for key in end.journal if key.startswith("lost_contact")]


def test_node_that_never_heard_anybody_acts_after_the_time_from_its_start() -> None:
    end = start({}, 0)
    run(end, AFTER_S - 0.001)
    assert end.got(ContactLost) == []
    run(end, AFTER_S)
    assert end.got(ContactLost) == [ContactLost(name=NAME, silent_since=0, lost_at=ns(AFTER_S))]


def test_it_acts_once_per_loss_and_contact_arms_it_again() -> None:
    end = start({}, 0)
    hear(end, 1, 100)
    run(end, 100 + AFTER_S - 0.001)
    assert end.got(ContactLost) == []
    run(end, 100_000)
    assert len(end.got(ContactLost)) == 1
    assert end.engine.poll_timeout() is None
    assert end.engine.lost_contact.acted(NAME, end.now)
    assert not end.engine.lost_contact.acted(NAME, end.now)
    assert not end.engine.lost_contact.acted("nothing of that name", end.now)
    run(end, 200_000)
    assert len(end.got(ContactLost)) == 1
    hear(end, 1, 200_001)
    assert end.got(ContactRestored) == [
        ContactRestored(name=NAME, source=1, restored_at=ns(200_001), acted=True)
    ]
    assert phase(end) is ContactPhase.COUNTING
    run(end, 200_001 + AFTER_S)
    assert len(end.got(ContactLost)) == 2
    hear(end, 1, 201_000)
    assert not end.got(ContactRestored)[1].acted
    assert not end.engine.lost_contact.acted(NAME, end.now)  # the answer came after the contact


def test_any_node_of_the_list_is_contact_and_no_other_is() -> None:
    end = start({}, 0, of=rules(1, 2))
    for at_s in range(100, 1000, 100):
        hear(end, 1 + at_s // 100 % 2, at_s)
        run(end, at_s + 99)
    assert end.got(ContactLost) == []
    end = start({}, 0, of=rules(1))
    for at_s in range(10, 200, 10):
        hear(end, 2, at_s)
        run(end, at_s + 9)
    assert len(end.got(ContactLost)) == 1


def test_without_a_list_any_other_node_is_contact() -> None:
    end = start({}, 0, of=rules())
    for at_s in range(100, 1000, 100):
        hear(end, 2, at_s)
        run(end, at_s + 99)
    assert end.got(ContactLost) == []


def test_unreadable_frames_and_own_frames_are_no_contact() -> None:
    end = End(
        3, fleet(), rules=rules(), capabilities=link(addressed=False, checked=False), is_up=True
    )
    noise = random.Random(5)
    for at_s in range(1, 160):
        run(end, at_s)
        end.hear(noise.randbytes(12), ns(at_s), source=0)
    run(end, AFTER_S)
    assert len(end.got(ContactLost)) == 1
    end = start({}, 0, of=rules())
    for at_s in range(10, 160, 10):
        run(end, at_s)
        hear(end, 3, at_s)
    run(end, AFTER_S)
    assert len(end.got(ContactLost)) == 1


def test_silence_a_link_that_is_down_and_a_clock_that_is_set_do_not_stop_it() -> None:
    all_day = (QuietWindow(0, ns(12 * 3600)), QuietWindow(ns(12 * 3600), 0))
    end = start({}, 0, of=msgspec.structs.replace(rules(1), quiet=all_day))
    end.engine.silence.begin(0)
    end.engine.handle_link_state(LinkState.DOWN, 0)
    for step in range(1, 16):
        run(end, 10 * step)
        end.engine.handle_clock((-1) ** step * 10**9 * NS_PER_S, None, end.now)
    assert end.got(ContactLost) == []
    run(end, AFTER_S)
    (lost,) = end.got(ContactLost)
    assert lost.lost_at == ns(AFTER_S)


def test_node_whose_link_never_came_up_acts() -> None:
    end = End(3, fleet(), rules=rules(1), is_up=False)
    end.engine.handle_clock(0, None, 0)  # what a runner does before it opens the link
    run(end, AFTER_S)
    assert len(end.got(ContactLost)) == 1


@pytest.mark.parametrize("pause_s", [0.0, 3.0, 50.0])
def test_restart_on_the_same_boot_continues_the_countdown_exactly(pause_s: float) -> None:
    end = start({}, 1000)
    hear(end, 1, 1000)
    now_s, lives = 1000.0, 1
    while not end.got(ContactLost):
        now_s += 7
        run(end, now_s)
        if not end.got(ContactLost):
            now_s += pause_s
            end, lives = start(end.journal, now_s), lives + 1
            run(end, now_s)
    assert lives > 2
    (lost,) = end.got(ContactLost)
    assert lost.silent_since == ns(1000)
    assert lost.lost_at >= ns(1000 + AFTER_S)
    assert lost.lost_at <= ns(1000 + AFTER_S + pause_s)


def test_restart_forgets_contact_by_a_sixteenth_of_the_time_at_most() -> None:
    end = start({}, 0)
    heard_s = 0
    for heard_s in range(1, 1000, 3):
        run(end, heard_s)
        hear(end, 1, heard_s)
    end = start(end.journal, heard_s)
    (countdown,) = end.engine.lost_contact.countdowns()
    assert heard_s - AFTER_S / 16 <= countdown.silent_since / NS_PER_S <= heard_s


def test_computer_that_restarts_all_the_time_acts_in_the_end() -> None:
    journal: dict[str, bytes] = {}
    for boot in range(30):
        end = start(journal, 0, boot=b"%d" % boot)
        run(end, 1)
        if end.got(ContactLost):
            break
        journal = end.journal
    assert boot <= 17


def test_another_boot_goes_on_with_what_is_left_and_a_part_less() -> None:
    end = start({}, 500)
    hear(end, 1, 500)
    run(end, 540)
    end = start(end.journal, 20, boot=b"two")
    (countdown,) = end.engine.lost_contact.countdowns()
    assert countdown.silent_since == ns(20 - 40 - 10)
    run(end, 20 + AFTER_S - 50)
    assert len(end.got(ContactLost)) == 1


def acted_end(*, of: TransmitRules | None = None) -> End:
    end = start({}, 0, of=of)
    run(end, AFTER_S + 1)
    assert end.engine.lost_contact.acted(NAME, end.now)
    end.settle()
    return end


def test_restart_repeats_a_loss_without_answer_and_no_answered_one() -> None:
    end = start({}, 0)
    run(end, AFTER_S + 1)
    again = start(end.journal, 200)
    run(again, 200)
    assert len(again.got(ContactLost)) == 1
    done = start(acted_end().journal, 200)
    run(done, 5000)
    assert done.got(ContactLost) == []
    assert phase(done) is ContactPhase.ACTED
    hear(done, 1, 5001)
    assert done.got(ContactRestored)[0].acted
    run(done, 5001 + AFTER_S)
    assert len(done.got(ContactLost)) == 1


def test_answer_is_not_trusted_after_a_boot_a_doubt_or_with_another_rule() -> None:
    journal = acted_end().journal
    for end in (
        start(journal, 200, boot=b"two"),
        start(journal, 200, boot=b""),
        start(journal | {DOUBT_KEY: b"an old copy"}, 200),
        start(journal, 200, of=rules(1, 2)),
        start(journal, 200, of=rules(1, after_s=AFTER_S - 1)),
    ):
        run(end, 201)
        assert len(end.got(ContactLost)) == 1


def test_longer_rule_counts_on_and_a_rule_that_is_gone_leaves_the_journal() -> None:
    journal = acted_end().journal
    end = start(journal, 200, of=rules(1, after_s=1000))
    run(end, 999)
    assert end.got(ContactLost) == []
    run(end, 1000)
    assert len(end.got(ContactLost)) == 1
    other = start(journal, 200, of=rules(1, name="abort"))
    assert [key for key in other.journal if "contact" in key] == ["lost_contact/abort"]


@pytest.mark.parametrize("entry", [b"", b"\xff", msgspec.msgpack.encode([1, "x"])])
def test_unreadable_entry_of_the_journal_begins_anew_and_raises_nothing(entry: bytes) -> None:
    end = start({f"lost_contact/{NAME}": entry}, 50)
    run(end, 50 + AFTER_S - 1)
    assert end.got(ContactLost) == []
    run(end, 50 + AFTER_S)
    assert len(end.got(ContactLost)) == 1


def test_journal_that_cannot_be_written_does_not_hold_it_up() -> None:
    end = End(3, fleet(), rules=rules(1), commits=False)
    end.engine.handle_journal_state("disk full", 0)
    run(end, AFTER_S)
    assert len(end.got(ContactLost)) == 1


def test_it_commits_rarely() -> None:
    end = start({}, 0)
    commits = 0
    for at_s in range(1, 3600):
        before = end.journal[f"lost_contact/{NAME}"]
        run(end, at_s)
        hear(end, 1, at_s)
        commits += before != end.journal[f"lost_contact/{NAME}"]
    assert 300 <= commits <= 3600 / (AFTER_S / 16) + 1


def test_several_rules_are_stages() -> None:
    contact = ContactRules(
        lost_contact=tuple(
            LostContactRule(name=f"stage{number}", nodes=(1,), lost_after_s=number * 100.0)
            for number in (1, 2, 3)
        )
    )
    end = start({}, 0, of=TransmitRules(contact=contact))
    run(end, 250)
    assert [each.name for each in end.got(ContactLost)] == ["stage1", "stage2"]
    hear(end, 1, 251)
    assert [each.name for each in end.got(ContactRestored)] == ["stage1", "stage2"]


def test_replay_of_the_calls_gives_the_same_events() -> None:
    def make() -> Engine:
        return Engine(
            address=3, table=fleet(), epoch=1, rng=random.Random(1), rules=rules(1),
            stored={BOOT_KEY: b"one"},
        )  # fmt: skip

    calls: list[EngineCall] = []
    engine = make()
    Tap(engine, calls.append)
    engine.handle_clock(0, 0, 0)
    engine.handle_timeout(ns(AFTER_S))
    assert engine.lost_contact.acted(NAME, ns(AFTER_S + 1))
    assert "lost_contact.acted" in [each.name for each in calls]
    again = make()
    for each in calls:
        assert call_engine(again, each.name, each.arguments) == each.result
    assert again.lost_contact.countdowns() == engine.lost_contact.countdowns()


def test_a_recording_has_the_rules() -> None:
    written = rules(1, 2)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(written), type=TransmitRules) == written


@pytest.mark.parametrize("seed", range(20))
def test_flapping_contact_acts_once_for_each_silence_that_lasts(seed: int) -> None:
    draw = random.Random(seed)
    end, at_s, expected = start({}, 0), 0.0, 0
    for _ in range(40):
        gap_s = draw.choice([0.5, AFTER_S - 1, AFTER_S + 1, 5 * AFTER_S])
        at_s += gap_s
        expected += gap_s > AFTER_S
        run(end, at_s)
        assert len(end.got(ContactLost)) == expected
        if draw.random() < 0.5:  # the program was as fast as the flapping, or not
            end.engine.lost_contact.acted(NAME, end.now)
        hear(end, 1, at_s)
        assert phase(end) is ContactPhase.COUNTING
    assert len(end.got(ContactRestored)) == expected
