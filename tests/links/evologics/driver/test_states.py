"""Every state with every input, and what holds in all of them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.links.evologics.driver.bench import Bench, ScriptedModem
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkState, Transmission, TransmitOutcome
from zacoustic.errors import LocalError
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.driver.sending.states import TRANSITIONS as PHASES
from zacoustic_evologics.driver.sending.states import Phase, Word
from zacoustic_evologics.driver.states import CONNECTED, TRANSITIONS, UP, Input, State

FROM_OUTSIDE = {Input.OPENED, Input.GONE, Input.CLOSED, Input.TRANSMIT}


def bench_in(state: State) -> Bench:
    """A dialogue that has come to a state by itself."""
    bench = Bench()
    bench.reconnects = False
    if state is State.CLOSED:
        return bench
    bench.connect()
    if state is State.SENDING:
        bench.until(lambda: bench.dialogue.state is State.READY)
        bench.transmit(b"under way")
        bench.run(0.1)
    elif state is State.LOST:
        bench.cut()
    else:
        bench.until(lambda: bench.dialogue.state is state)
    assert bench.dialogue.state is state
    return bench


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("event", Input)
def test_every_pair_has_a_next_state_or_is_refused(state: State, event: Input) -> None:
    dialogue = bench_in(state).dialogue
    after = TRANSITIONS.get((state, event))
    if after is None:
        with pytest.raises(LocalError, match=state.value):
            dialogue._step(event)
        assert dialogue.state is state
    else:
        dialogue._step(event)
        assert dialogue.state is after


@pytest.mark.parametrize("state", State)
def test_every_state_can_be_opened_lost_and_closed(state: State) -> None:
    for event, after in (("open", State.SETTLING), ("lose", State.LOST), ("close", State.CLOSED)):
        bench = bench_in(state)
        if event == "open":
            bench.connect()
        elif event == "lose":
            bench.cut()
        else:
            bench.dialogue.close(bench.now)
            bench.serve()
        assert bench.dialogue.state is after
        outstanding = 1 if state is State.SENDING else 0
        assert [each.outcome for each in bench.reports] == [TransmitOutcome.ABORTED] * outstanding
        if state in UP and event != "close":
            down = bench.order.index("LinkChanged", bench.order.index("LinkChanged") + 2)
            assert not outstanding or down < bench.order.index("TransmissionEnded")
        if event != "open":
            assert bench.dialogue.poll_timeout() is None


@pytest.mark.parametrize("state", State)
def test_every_state_answers_a_transmission_with_one_report(state: State) -> None:
    bench = bench_in(state)
    transmission_id = bench.transmit(b"now")
    reports = bench.reports_of(transmission_id)
    if state is State.READY:
        assert reports == []
    elif state is State.SENDING:
        assert reports[0].outcome is TransmitOutcome.REJECTED
    else:
        assert reports[0].outcome is TransmitOutcome.ABORTED
        assert reports[0].detail.startswith("link down: ")
    bench.run(20.0)
    assert len(bench.reports_of(transmission_id)) == 1


@pytest.mark.parametrize("state", State)
@given(garbage=st.binary(min_size=1, max_size=300), later_s=st.floats(0.0, 20.0))
@settings(max_examples=15, deadline=None)
def test_every_state_bears_garbage_and_time(state: State, garbage: bytes, later_s: float) -> None:
    bench = bench_in(state)
    bench.reconnects = True
    bench.dialogue.handle_bytes(garbage, bench.now)
    bench.serve()
    bench.run(later_s)
    bench.dialogue.handle_timeout(bench.now)
    bench.serve()
    assert len({each.transmission_id for each in bench.reports}) == len(bench.reports)


@pytest.mark.parametrize("state", [state for state in State if state in CONNECTED - UP])
def test_a_silent_modem_leads_from_every_state_to_a_new_connection(state: State) -> None:
    bench = bench_in(state)
    bench.modem.feed = lambda raw: None  # type: ignore[method-assign]
    bench.modem.write = lambda raw: None
    bench.until(lambda: bench.resets, 10.0)
    assert bench.dialogue.state is State.LOST


def test_an_idle_dialogue_has_no_timer() -> None:
    bench = Bench()
    assert bench.dialogue.poll_timeout() is None
    bench.make_ready()
    assert bench.dialogue.poll_timeout() is None
    for acknowledge in (False, True):
        bench.send(b"x", 2, acknowledge=acknowledge)
        bench.run(0.5)
        assert bench.dialogue.poll_timeout() is None
    written = len(bench.written)
    bench.run(3600.0)
    assert len(bench.written) == written, "it polls while idle"


@pytest.mark.parametrize("phase", Phase)
@pytest.mark.parametrize("word", Word)
def test_every_phase_with_every_word_goes_on_or_stays(phase: Phase, word: Word) -> None:
    after = PHASES.get((phase, word), phase)
    assert isinstance(after, Phase)
    if phase is Phase.OVER or word is Word.LOST:
        assert after is Phase.OVER


def test_a_frame_is_given_again_only_after_the_modem_has_refused_or_returned_it() -> None:
    back: dict[Phase, set[Phase]] = {phase: set() for phase in Phase}
    for (phase, word), after in PHASES.items():
        refused = phase is Phase.GIVING and word in (Word.NOT_NOW, Word.MENDABLE)
        refused |= word is Word.RETURNED
        if not refused:
            back[phase].add(after)
    reached, to_do = set[Phase](), [Phase.GIVING]
    while to_do:
        for after in back[to_do.pop()] - {Phase.GIVING} - reached:
            reached.add(after)
            to_do.append(after)
    assert not reached & {Phase.PREPARING, Phase.CHECKING, Phase.PAUSING, Phase.MENDING}
    assert all(Phase.GIVING not in back[phase] for phase in reached)


INPUTS = st.lists(
    st.one_of(
        st.just(("open", b"")),
        st.just(("lose", b"")),
        st.just(("time", b"")),
        st.just(("transmit", b"")),
        st.just(("acknowledged", b"")),
        st.just(("close", b"")),
        st.sampled_from(
            [b"OK\r\n", b"NET\r\n", b"AT\r\n", b"ERROR WRONG FORMAT\r\n", b"BUSY BACKOFF STATE\r\n",
             b"7\r\n", b"1\r\n", b"14\r\n", b"INITIATION LISTEN\r\n", b"EMPTY\r\n",
             b"DELIVERING\r\n", b"DELIVEREDIM,2\r\n", b"FAILEDIM,2\r\n", b"SENDEND,2,im,1,2\r\n",
             b"SENDSTART,2,im,200000,0\r\n", b"CANCELEDIM,2\r\n", b"RECVSTART\r\n", b"PHYOFF\r\n",
             b"RECVEND,1,2,-3,4\r\n", b"+++AT?MODE:2:AT\r\n", b"+++AT:9:RECVSTART\r\n",
             b"RECVIM,5,2,1,ack,204800,-45,133,0.0458,hello\r\n", b"ERROR EFAULT\r\n", b"\r\n"]
        ).map(lambda line: ("bytes", line)),
        st.binary(max_size=20).map(lambda raw: ("bytes", raw)),
    ),
    max_size=60,
)  # fmt: skip


@given(inputs=INPUTS, seed=st.integers(0, 3))
@settings(max_examples=150, deadline=None)
def test_any_order_of_inputs_gives_one_report_for_each_frame(
    inputs: list[tuple[str, bytes]], seed: int
) -> None:
    dialogue = AtDialogue(EvologicsConfig(), node_address=1, is_serial=bool(seed & 1))
    if seed & 2:
        dialogue = bench_in(State.READY).dialogue
    now, sent = 10_000 * NS_PER_S, 0
    reports: list[int] = []
    for name, raw in inputs:
        now += 50_000_000
        match name:
            case "open":
                dialogue.handle_opened(now)
            case "lose":
                dialogue.handle_lost("lost", now)
            case "time":
                due_at = dialogue.poll_timeout()
                now = max(now, due_at or 0)
                dialogue.handle_timeout(now)
            case "close":
                dialogue.close(now)
            case "bytes":
                dialogue.handle_bytes(raw, now)
            case _:
                sent += 1
                acknowledge = name == "acknowledged"
                dialogue.transmit(
                    Transmission(
                        transmission_id=1000 + sent,
                        frame_bytes=b"x",
                        destination=2,
                        acknowledge=acknowledge,
                    ),
                    now,
                )
        while dialogue.poll_output() is not None:
            pass
        while (event := dialogue.poll_event()) is not None:
            if type(event).__name__ == "TransmissionEnded":
                reports.append(event.report.transmission_id)  # type: ignore[union-attr]
    dialogue.close(now)
    while (event := dialogue.poll_event()) is not None:
        if type(event).__name__ == "TransmissionEnded":
            reports.append(event.report.transmission_id)  # type: ignore[union-attr]
    assert sorted(reports) == [1000 + at for at in range(1, sent + 1)]


def test_up_is_told_with_capabilities_and_down_with_a_reason() -> None:
    bench = bench_in(State.READY)
    bench.cut("cable pulled")
    assert [state for state, _ in bench.changes] == [
        LinkState.OPENING, LinkState.UP, LinkState.DOWN,
    ]  # fmt: skip
    assert bench.changes[-1][1] == "cable pulled"
    bench.connect()
    bench.until(lambda: bench.dialogue.state is State.READY)
    assert [state for state, _ in bench.changes[-2:]] == [LinkState.DOWN, LinkState.UP]
    assert ScriptedModem().settings["ZX"] == 0
