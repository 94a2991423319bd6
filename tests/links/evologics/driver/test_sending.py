"""One frame, and its one report, whatever the modem says and does not say."""

import itertools

import pytest

from tests.links.evologics.driver.bench import IGNORED, Bench, ScriptedModem
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.linktypes import TransmitOutcome, TransmitReport
from zacoustic_evologics.at.commands import SendBurst, SendIm, SendIms
from zacoustic_evologics.at.framing import Framing, Interpreter
from zacoustic_evologics.at.messages import Reply
from zacoustic_evologics.at.notifications import (
    AsyncError,
    CanceledIm,
    DeliveredIm,
    FailedIm,
    FaultKind,
    ImFlag,
    RecvEnd,
    RecvStart,
    SendEnd,
)
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.sending.states import Phase
from zacoustic_evologics.driver.states import State

SENT, DELIVERED, NOT_DELIVERED = (
    TransmitOutcome.SENT,
    TransmitOutcome.DELIVERED,
    TransmitOutcome.NOT_DELIVERED,
)
REJECTED, ABORTED = TransmitOutcome.REJECTED, TransmitOutcome.ABORTED
BURSTS = EvologicsConfig(mtu=1024)


def ready(modem: ScriptedModem | None = None, config: EvologicsConfig | None = None) -> Bench:
    bench = Bench(modem or ScriptedModem(), config)
    bench.make_ready()
    return bench


def quiet(bench: Bench) -> None:
    """Nothing of the frame is left: no timer, no command, no second report."""
    bench.run(100.0)
    ids = [each.transmission_id for each in bench.reports]
    assert len(set(ids)) == len(ids)
    if bench.dialogue.state is State.READY:
        assert bench.dialogue.poll_timeout() is None


def test_message_without_acknowledgement_is_sent_when_its_sound_has_ended() -> None:
    bench = ready()
    report = bench.send(bytes(64))
    assert report.outcome is SENT
    assert report.detail.startswith("SENDEND,255,im,")
    assert ns_to_seconds(report.finished_at - report.started_at) == pytest.approx(0.860, abs=0.002)
    assert bench.modem.sent == [SendIm(payload=bytes(64), destination=255, flag=ImFlag.NOACK)]
    quiet(bench)


def test_acknowledged_message_is_delivered_in_the_words_of_the_modem() -> None:
    bench = ready()
    report = bench.send(b"to you", 2, acknowledge=True)
    assert (report.outcome, report.detail) == (DELIVERED, "DELIVEREDIM,2")
    assert bench.modem.sent == [SendIm(payload=b"to you", destination=2, flag=ImFlag.ACK)]
    bench.run(0.1)
    assert bench.dialogue.diagnostics()["peer_2_propagation_s"] == 0.001
    quiet(bench)


def test_message_that_is_not_acknowledged_is_not_delivered() -> None:
    bench = ready()
    bench.modem.delivers = False
    report = bench.send(b"to you", 2, acknowledge=True)
    assert (report.outcome, report.detail) == (NOT_DELIVERED, "FAILEDIM,2")
    quiet(bench)


def test_broadcast_is_never_acknowledged() -> None:
    bench = ready()
    assert bench.send(b"all", 255, acknowledge=True).outcome is SENT


def test_synchronous_messages_carry_frames_where_configured() -> None:
    bench = ready(config=EvologicsConfig(service="ims"))
    assert not bench.dialogue.capabilities.acknowledges
    report = bench.send(b"in time", 2, acknowledge=True)
    assert report.outcome is SENT
    assert bench.modem.sent == [SendIms(payload=b"in time", destination=2)]


@pytest.mark.parametrize(
    ("line", "outcome"),
    [("EXPIREDIMS,2", REJECTED), ("CANCELEDIMS,2", ABORTED), ("CANCELLEDIMS,2", ABORTED)],
)
def test_synchronous_message_that_does_not_leave(line: str, outcome: TransmitOutcome) -> None:
    bench = ready(config=EvologicsConfig(service="ims"))
    bench.modem.tells_end = False
    transmission_id = bench.transmit(b"late", 2)
    bench.run(0.3)
    bench.modem.write_line(line)
    bench.run(0.1)
    (report,) = bench.reports_of(transmission_id)
    assert (report.outcome, report.detail) == (outcome, line.replace("LL", "L"))


@pytest.mark.parametrize(("delivers", "outcome"), [(True, DELIVERED), (False, NOT_DELIVERED)])
@pytest.mark.parametrize("service", ["auto", "burst"])
def test_large_frame_goes_by_burst_data_and_its_number(
    delivers: bool, outcome: TransmitOutcome, service: str
) -> None:
    bench = ready(config=EvologicsConfig(mtu=1024, service=service))  # type: ignore[arg-type]
    bench.modem.delivers = delivers
    bench.modem.settings["PC"] = 765
    report = bench.send(bytes(1024), 2)
    word = "DELIVERED" if delivers else "FAILED"
    assert (report.outcome, report.detail) == (outcome, f"{word},765,2")
    assert bench.modem.names()[-3:] == ["?S", "?PC", "*SEND"]
    small = bench.send(b"small", 2)
    last = bench.modem.sent[-1]
    assert isinstance(last, SendBurst if service == "burst" else SendIm)
    assert small.outcome is not ABORTED
    assert bench.send(b"all").outcome is SENT
    quiet(bench)


def test_burst_of_another_number_proves_nothing() -> None:
    bench = ready(config=BURSTS)
    transmission_id = bench.transmit(bytes(100), 2)
    bench.run(0.5)
    bench.modem.write_line("DELIVERED,4,2")
    bench.modem.write_line("FAILED,5,3")
    assert bench.reports_of(transmission_id) == []
    bench.run(3.0)
    assert bench.reports_of(transmission_id)[0].detail == "DELIVERED,5,2"


@pytest.mark.parametrize(
    ("content", "to", "reason"),
    [
        (b"", 2, "frame of 0 bytes; allowed: 1..64"),
        (bytes(65), 2, "frame of 65 bytes; allowed: 1..64"),
        (b"x", 0, "destination 0; allowed: 1..14 "),
        (b"x", 15, "destination 15; allowed: 1..14 (highest address of the network) and 255"),
        (b"x", 256, "destination 256; allowed"),
        (b"x", 1, "destination 1 is this node"),
    ],
)
def test_what_cannot_be_sent_is_rejected_and_never_said(
    content: bytes, to: int, reason: str
) -> None:
    bench = ready()
    report = bench.send(content, to)
    assert report.outcome is REJECTED
    assert report.detail.startswith(reason)
    assert bench.modem.sent == []


def test_large_broadcast_is_rejected() -> None:
    bench = ready(config=BURSTS)
    assert bench.send(bytes(65)).detail.startswith("broadcast of 65 bytes")


@pytest.mark.parametrize("payload", [b"a,b\r\nc", b"+++AT*SENDIM:2:OK\r\n", b"\r", b"\n\n", b"\0"])
@pytest.mark.parametrize("framing", Framing)
def test_payload_is_carried_whatever_is_in_it(payload: bytes, framing: Framing) -> None:
    interpreter = Interpreter.NET if framing is Framing.LINES else Interpreter.AT
    bench = ready(ScriptedModem(interpreter, framing))
    assert bench.send(payload).outcome is SENT
    assert bench.modem.sent[-1].payload == payload


@pytest.mark.parametrize("size", [5, 100])
def test_on_deck_no_frame_goes_before_the_modem_is_quiet(size: int) -> None:
    bench = ready(config=EvologicsConfig(mtu=1024, deck=True))
    bench.modem.restart()
    bench.modem.settings |= {"L": 0, "ZX": 1}  # as it was stored
    assert bench.send(bytes(size), 2).outcome in (SENT, DELIVERED)
    names = bench.modem.names()
    assert bench.modem.settings["L"] == 3
    given_at = names.index("*SENDIM" if size < 64 else "*SEND")
    assert "!L" in names[given_at - 2 : given_at]
    bench.modem.answers["!L"] = ["ERROR NO CONTROL"]
    report = bench.send(bytes(size), 2)
    assert (report.outcome, report.detail) == (REJECTED, "ERROR NO CONTROL")


# BUSY and ERROR


def test_busy_modem_is_asked_until_it_has_time() -> None:
    bench = ready()
    bench.modem.answers["*SENDIM"] = ["BUSY BACKOFF STATE", "BUSY DELIVERING INSTANT MESSAGE"]
    called_at = bench.now
    report = bench.send(b"patience")
    assert report.outcome is SENT
    assert len(bench.modem.sent) == 3
    assert 2.0 < ns_to_seconds(report.finished_at - called_at) < 3.0
    assert bench.modem.names().count("?S") == 3
    quiet(bench)


def test_busy_modem_is_asked_at_once_when_a_sound_has_ended() -> None:
    bench = ready()
    bench.modem.answers["*SENDIM"] = ["BUSY"]
    transmission_id = bench.transmit(b"soon")
    bench.run(0.1)
    bench.modem.say(RecvEnd(clock_us=1, duration_us=2, rssi_db=-50, integrity=100))
    bench.run(0.4)
    assert bench.reports_of(transmission_id)[0].outcome is SENT


def test_modem_that_stays_busy_rejects_in_its_own_words() -> None:
    bench = ready(config=EvologicsConfig(busy_s=5.0))
    bench.modem.answers["*SENDIM"] = ["BUSY BACKOFF STATE"] * 100
    called_at = bench.now
    report = bench.send(b"never")
    assert (report.outcome, report.detail) == (REJECTED, "BUSY BACKOFF STATE, 5 s long")
    assert 4.9 < ns_to_seconds(report.finished_at - called_at) < 6.1
    assert bench.modem.sent
    quiet(bench)
    bench.modem.answers.clear()
    assert bench.send(b"again").outcome is SENT


def test_frame_is_not_given_while_the_modem_has_no_time() -> None:
    bench = ready(config=EvologicsConfig(busy_s=3.0))
    bench.modem.answers["*SENDIM"] = ["BUSY"]
    bench.modem.state = "BACKOFF STATE"
    assert bench.send(b"never").outcome is REJECTED
    assert len(bench.modem.sent) == 1


@pytest.mark.parametrize("spelling", ["BUFFERS ARE", "BUFFER IS", "BUFFERS"])
def test_full_buffers_are_emptied_once(spelling: str) -> None:
    bench = ready(config=EvologicsConfig(mtu=1024, busy_s=4.0))
    bench.modem.answers["*SEND"] = [f"ERROR {spelling} NOT EMPTY"]
    assert bench.send(bytes(100), 2).outcome is DELIVERED
    assert bench.modem.names().count("Z") == 1
    bench.modem.answers["*SEND"] = [f"ERROR {spelling} NOT EMPTY"] * 9
    report = bench.send(bytes(100), 2)
    assert (report.outcome, report.detail) == (REJECTED, f"ERROR {spelling} NOT EMPTY, 4 s long")
    assert bench.modem.names().count("Z") == 2


def test_physical_layer_that_is_off_is_switched_on() -> None:
    bench = ready()
    bench.modem.answers["*SENDIM"] = ["ERROR PHY OFF"]
    assert bench.send(b"on").outcome is SENT
    assert "A" in bench.modem.names()


@pytest.mark.parametrize(
    "words", ["WRONG FORMAT", "OUT OF RANGE", "WRONG DESTINATION ADDRESS", "SOMETHING NEW", ""]
)
def test_error_that_stays_rejects_in_the_words_of_the_modem(words: str) -> None:
    bench = ready()
    text = f"ERROR {words}".strip()
    bench.modem.answers["*SENDIM"] = [text]
    report = bench.send(b"no")
    assert (report.outcome, report.detail) == (REJECTED, text)
    assert len(bench.modem.sent) == 1
    assert bench.send(b"yes").outcome is SENT


def test_errors_that_answer_nothing_are_only_counted() -> None:
    bench = ready()
    bench.modem.answers["*SENDIM"] = [IGNORED]
    transmission_id = bench.transmit(b"x")
    bench.modem.say(AsyncError(FaultKind.EFAULT))
    bench.modem.say(AsyncError(FaultKind.OVERLOAD))
    assert bench.reports_of(transmission_id) == []
    assert bench.dialogue.diagnostics()["faults"] == 1
    assert bench.dialogue.diagnostics()["overloads"] == 1


# Lost and late answers


@pytest.mark.parametrize("acknowledge", [False, True])
def test_lost_ok_is_not_asked_for_again(acknowledge: bool) -> None:
    bench = ready()
    bench.modem.answers["*SENDIM"] = [None]
    report = bench.send(bytes(64), 2, acknowledge=acknowledge)
    assert report.outcome is (DELIVERED if acknowledge else SENT)
    assert len(bench.modem.sent) == 1
    quiet(bench)


def test_lost_ok_of_a_burst_is_found_out_by_its_number() -> None:
    bench = ready(config=BURSTS)
    bench.modem.answers["*SEND"] = [None]
    assert bench.send(bytes(100), 2).outcome is DELIVERED
    assert len(bench.modem.sent) == 1


@pytest.mark.parametrize("acknowledge", [False, True])
def test_frame_that_the_modem_never_heard_is_aborted(acknowledge: bool) -> None:
    bench = ready()
    bench.modem.answers["*SENDIM"] = [IGNORED]
    report = bench.send(b"unheard", 2, acknowledge=acknowledge)
    assert report.outcome is ABORTED
    assert report.detail == "no answer; then AT?DI: EMPTY"
    assert bench.dialogue.state is State.READY
    assert bench.send(b"heard", 2, acknowledge=acknowledge).outcome is not ABORTED


def test_burst_that_the_modem_never_heard_is_aborted() -> None:
    bench = ready(config=BURSTS)
    bench.modem.answers["*SEND"] = [IGNORED]
    assert bench.send(bytes(100), 2).detail == "no answer; then AT?PC: 5"


def test_late_ok_is_not_taken_for_the_answer_to_the_next_frame() -> None:
    bench = ready()
    bench.modem.answers["*SENDIM"] = [IGNORED, "BUSY"]
    bench.transmit(b"first", 2)
    bench.run(1.001)  # given up, and the fence is on its way
    bench.modem.write_line("OK")
    bench.until(lambda: bench.reports)
    assert bench.reports[0].outcome is ABORTED
    assert bench.dialogue.diagnostics()["late_replies"] == 1
    transmission_id = bench.transmit(b"second", 2)
    bench.run(0.2)
    assert bench.reports_of(transmission_id) == [], "BUSY was its answer"
    bench.run(3.0)
    assert bench.reports_of(transmission_id)[0].outcome is SENT


def test_word_that_comes_too_soon_is_about_an_earlier_message() -> None:
    bench = ready()
    bench.modem.tells_end = False
    transmission_id = bench.transmit(bytes(64), 2, acknowledge=True)
    bench.run(0.05)
    for record in (DeliveredIm(2), FailedIm(2), DeliveredIm(3)):
        bench.modem.say(record)
    bench.run(0.3)
    assert bench.reports_of(transmission_id) == []
    assert "?DI" not in bench.modem.names()[-1:]


@pytest.mark.parametrize("old", [DeliveredIm(2), FailedIm(2), CanceledIm(2)])
def test_late_word_about_an_earlier_message_is_found_out_by_asking(
    old: DeliveredIm | FailedIm | CanceledIm,
) -> None:
    for delivers, outcome in ((True, DELIVERED), (False, NOT_DELIVERED)):
        bench = ready()
        bench.modem.delivers = delivers
        transmission_id = bench.transmit(bytes(64), 2, acknowledge=True)
        bench.run(0.95)  # behind its sound, before its acknowledgement
        bench.modem.say(old)
        bench.run(0.05)
        assert bench.reports_of(transmission_id) == []
        assert bench.modem.names()[-1] == "?DI"
        bench.until(lambda: bench.reports)  # noqa: B023
        assert bench.reports_of(transmission_id)[0].outcome is outcome


def test_late_end_of_an_earlier_sound_is_found_out_by_its_clock() -> None:
    bench = ready()
    transmission_id = bench.transmit(bytes(64), 2)
    bench.run(0.6)
    early_us = (bench.modem.clock_us - 1_500_000) % 2**32
    bench.modem.say(SendEnd(destination=2, kind="im", clock_us=early_us, duration_us=860_338))
    assert bench.reports_of(transmission_id) == []
    bench.run(0.4)
    assert bench.reports_of(transmission_id)[0].outcome is SENT


def test_end_by_a_clock_that_is_another_is_believed() -> None:
    bench = ready()
    bench.modem.tells_end = False
    transmission_id = bench.transmit(bytes(64), 2)
    bench.run(0.87)
    bench.modem.say(SendEnd(destination=2, kind="im", clock_us=12_345, duration_us=860_338))
    (report,) = bench.reports_of(transmission_id)
    assert report.detail == "SENDEND,2,im,12345,860338"


def test_without_notifications_a_word_is_checked_by_asking() -> None:
    bench = ready(config=EvologicsConfig(extended_notifications=False))
    report = bench.send(b"to you", 2, acknowledge=True)
    assert (report.outcome, report.detail) == (DELIVERED, "DELIVEREDIM,2")
    assert "?DI" in bench.modem.names()


@pytest.mark.parametrize(
    ("acknowledge", "state", "outcome"),
    [
        (False, "EMPTY", SENT),
        (True, "DELIVERED", DELIVERED),
        (True, "FAILED", NOT_DELIVERED),
        (True, "EMPTY", ABORTED),
        (False, "EXPIRED", REJECTED),
    ],
)
def test_when_no_word_comes_the_modem_is_asked(
    acknowledge: bool, state: str, outcome: TransmitOutcome
) -> None:
    bench = ready()
    bench.modem.tells_end = False
    bench.modem.answers["?DI"] = ["DELIVERING", state]
    report = bench.send(b"silent", 2, acknowledge=acknowledge)
    assert (report.outcome, report.detail) == (outcome, f"AT?DI: {state}")
    assert bench.modem.names()[-1] in ("?ZX", "?T")
    quiet(bench)


def test_without_notifications_the_modem_is_asked_when_the_sound_must_have_ended() -> None:
    bench = ready(config=EvologicsConfig(extended_notifications=False))
    report = bench.send(bytes(64))
    assert (report.outcome, report.detail) == (SENT, "AT?DI: EMPTY")
    assert ns_to_seconds(report.finished_at - report.started_at) == pytest.approx(0.87, abs=0.12)
    assert bench.send(bytes(64), 2, acknowledge=True).outcome is DELIVERED


def test_restarted_modem_is_not_believed_to_have_sent() -> None:
    bench = ready()
    transmission_id = bench.transmit(bytes(64), 2)
    bench.run(0.3)
    bench.modem.restart()
    bench.modem.tells_end = False
    bench.until(lambda: bench.reports_of(transmission_id))
    assert bench.reports_of(transmission_id)[0].outcome is ABORTED
    assert "restarted" in bench.reports_of(transmission_id)[0].detail
    down = [text for _, text in bench.changes if "restarted" in text]
    assert down
    bench.modem.tells_end = True
    bench.until(lambda: bench.dialogue.state is State.READY)
    assert bench.modem.settings["ZX"] == 1
    assert bench.send(b"back").outcome is SENT


def test_message_that_never_ends_is_dropped_in_the_modem() -> None:
    bench = ready()
    bench.modem.tells_end = False
    bench.modem.answers["?DI"] = ["DELIVERING"] * 200
    report = bench.send(b"stuck", 2, acknowledge=True)
    assert (report.outcome, report.detail.split(";")[1]) == (ABORTED, " dropped")
    assert bench.modem.names()[-1] == "Z"
    assert 15 < ns_to_seconds(report.finished_at - report.started_at) < 17


def test_burst_that_never_ends_is_dropped_in_the_modem() -> None:
    bench = ready(config=BURSTS)
    bench.modem.tells_end = False
    report = bench.send(bytes(100), 2)
    assert report.outcome is ABORTED
    assert bench.modem.names()[-1] == "Z"
    assert 60 < ns_to_seconds(report.finished_at - report.started_at) < 62


def test_modem_that_falls_silent_costs_the_connection_and_one_report() -> None:
    for phase in (Phase.GIVING, Phase.FLYING):
        bench = ready()
        transmission_id = bench.transmit(bytes(64), 2, acknowledge=True)
        if phase is Phase.FLYING:
            bench.run(0.2)
        bench.modem.feed = lambda raw: None  # type: ignore[method-assign]
        bench.modem.tells_end = False
        bench.until(lambda: bench.reports_of(transmission_id))  # noqa: B023
        assert bench.reports_of(transmission_id)[0].outcome is ABORTED
        assert bench.resets == ["the modem does not answer"]
        assert bench.order[-3:] in (
            ["LinkChanged", "TransmissionEnded", "ConnectionUseless"],
            ["TransmissionEnded", "ConnectionUseless", "LinkChanged"],
        )


def test_what_cannot_be_the_answer_is_not_taken_for_it() -> None:
    bench = ready(config=BURSTS)
    noise = ["INITIATION LISTEN", "17", "EMPTY", "#*?", "DELIVERED", "NET"]
    say_reply = bench.modem._say_reply

    def noisy(reply: Reply, text: str) -> None:
        for line in noise:
            if not (text.isdigit() and line.isdigit()) and line != text and text != "EMPTY":
                bench.modem.write_line(line)
        say_reply(reply, text)

    bench.modem._say_reply = noisy  # type: ignore[method-assign]
    assert bench.send(b"through", 2).outcome is SENT
    assert bench.resets == []
    assert bench.dialogue.diagnostics()["missed_replies"] == 0
    assert bench.dialogue.diagnostics()["stray_replies"] == len(noise)


def test_frame_waits_for_one_inquiry_at_most() -> None:
    bench = ready()

    def go_on(report: TransmitReport) -> None:
        if len(bench.reports) < 3:
            bench.transmit(b"next", 2)

    bench.on_report = go_on
    bench.send(b"first", 2, acknowledge=True)
    bench.run(5.0)
    assert [each.outcome for each in bench.reports] == [DELIVERED, SENT, SENT]
    assert bench.modem.names().count("?T") == 1


# Whatever the interleaving


@pytest.mark.parametrize("framing", Framing)
@pytest.mark.parametrize("acknowledge", [False, True])
def test_notifications_may_come_anywhere(framing: Framing, acknowledge: bool) -> None:
    """Another notification before, between and behind all that the modem says."""
    interpreter = Interpreter.NET if framing is Framing.LINES else Interpreter.AT
    noise = [
        "RECVSTART", "RECVEND,1,2,-40,100", "STATUS,INITIATION,LISTEN", "BITRATE,local,6900",
        "RECVIM,7,3,1,noack,200000,-45,133,0.0458,OK\r\nNET", "ERROR EFAULT",
        "RECVFAILED,0.0,-70,40",
        "DELIVEREDIM,9", "SENDEND,9,im,1,2", "RECVPBM,4,3,1,200000,-45,133,0.0458,BUSY",
    ]  # fmt: skip
    modem = ScriptedModem(interpreter, framing)
    bench = Bench(modem)
    lines = itertools.cycle(noise)
    write = modem.write

    def noisy(raw: bytes) -> None:
        for line in (next(lines), next(lines)):
            body = line.encode()
            wrapped = b"+++AT:%d:%s\r\n" % (len(body), body)
            write(wrapped if modem.decoder.framing is Framing.PACKETS else body + b"\r\n")
        write(raw)

    modem.write = noisy
    bench.connect()
    bench.until(lambda: bench.dialogue.state is State.READY)
    for _ in range(5):
        report = bench.send(b"through", 2, acknowledge=acknowledge)
        assert report.outcome is (DELIVERED if acknowledge else SENT)
        bench.run(0.2)
    assert bench.frames
    assert {each.frame_bytes for each in bench.frames} == {b"OK\r\nNET", b"BUSY"}
    assert bench.resets == []


@pytest.mark.parametrize("framing", Framing)
@pytest.mark.parametrize("size", [1, 2, 3, 7, 1000])
def test_the_cutting_of_bytes_means_nothing(framing: Framing, size: int) -> None:
    def split(raw: bytes) -> list[bytes]:
        return [raw[at : at + size] for at in range(0, len(raw), size)]

    interpreter = Interpreter.NET if framing is Framing.LINES else Interpreter.AT
    results = []
    for cut in (None, split):
        bench = Bench(ScriptedModem(interpreter, framing), BURSTS, split=cut)
        bench.make_ready()
        bench.send(b"one", 2, acknowledge=True)
        bench.send(bytes(200), 2)
        bench.modem.say(RecvStart())
        bench.modem.write_line("RECVIM,5,2,1,ack,204800,-45,133,0.0458,a\r\nbc")
        bench.run(1.0)
        results.append((bench.reports, bench.frames, bench.carrier, bench.modem.heard))
    assert results[0] == results[1]
