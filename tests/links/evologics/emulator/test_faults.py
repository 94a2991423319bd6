"""Each fault does what it says, when it is told to, and the same for the same seed."""

import pytest

from tests.links.evologics.emulator.sea import Sea
from zacoustic.errors import ConfigError
from zacoustic_evologics import Interpreter
from zacoustic_evologics.at.notifications import DeliveredIm, RecvIm, RecvStart, SendEnd, SendStart
from zacoustic_evologics.emulator import (
    FaultKind,
    FaultPlan,
    ModemDown,
    PortBytes,
    ScriptedFault,
)
from zacoustic_evologics.emulator.station.faults import plan_from_mapping

IM = b"AT*SENDIM,5,2,ack,hello\n"


def sea_with(kind: FaultKind, at_s: float = 0.0, **scripted: object) -> Sea:
    fault = ScriptedFault(kind=kind, at_s=at_s, **scripted)  # type: ignore[arg-type]
    return Sea(spacing_m=15.0, faults=FaultPlan(script=(fault,)), settings={"ZX": 1})


def test_busy_storm_lasts_as_long_as_it_says() -> None:
    sea = sea_with(FaultKind.BUSY, 1.0, lasts_s=2.0, modem=1)
    host = sea.host(1)
    answers = []
    for at_s in (0.5, 1.0, 2.9, 3.0):
        sea.run(at_s)
        answers.append(host.say(b"AT*SENDPBM,1,2,x\n")[0])
    assert [answer.partition(" ")[0] for answer in answers] == ["OK", "BUSY", "BUSY", "OK"]


def test_lost_reply_is_executed_all_the_same() -> None:
    sea = sea_with(FaultKind.LOST_REPLY)
    host = sea.host(1)
    assert host.say(b"AT!RI3\n") == []
    assert host.say(b"AT?RI\n") == ["3"]


def test_starred_and_efault_change_one_reply() -> None:
    assert sea_with(FaultKind.STARRED).host(1).say(b"AT!RI3\nAT!RI3\n") == ["[*]OK", "OK"]
    assert sea_with(FaultKind.EFAULT).host(1).say(b"AT?AL\n") == ["ERROR EFAULT", "1"]


def test_late_notification_comes_behind_what_follows_it() -> None:
    sea = sea_with(FaultKind.LATE, modem=1)
    near, _ = sea.host(1), sea.host(2)
    near.say(IM)
    sea.run()
    assert near.at(SendStart) > 0.0
    assert near.at(SendStart) < 2.0
    assert len(near.all_of(SendStart)) == 1


def test_duplicate_is_said_twice() -> None:
    sea = sea_with(FaultKind.DUPLICATE)
    near, far = sea.host(1), sea.host(2)
    near.say(IM)
    sea.run()
    assert len(far.all_of(RecvIm)) == 2
    assert len(near.all_of(DeliveredIm)) == 1


def test_garbage_half_lines_and_wrong_lengths_damage_what_is_said() -> None:
    sea = sea_with(FaultKind.GARBAGE, count=3)
    host = sea.host(1)
    assert host.say(b"AT?AL\nAT?AL\nAT?AL\nAT?AL\n")[-1] == "1"
    assert host.raw == b""
    assert len(sea.unrecognised()) >= 1
    sea = sea_with(FaultKind.HALF_LINE, 0.5, modem=2)
    near, far = sea.host(1), sea.host(2)
    sea.run(0.5)
    near.say(IM)
    sea.run()
    assert len(far.all_of(RecvIm)) + len(far.all_of(RecvStart)) < 2
    sea = sea_with(FaultKind.WRONG_LENGTH, count=9, modem=2)
    near, far = sea.host(1), sea.host(2)
    near.say(IM)
    sea.run()
    assert far.all_of(RecvIm) == []


def test_corruption_flips_bits_and_pieces_change_nothing() -> None:
    sea = sea_with(FaultKind.CORRUPT)
    assert sea.host(1).say(b"AT?BV\n") != ["24.1000"]
    sea = sea_with(FaultKind.PIECES)
    assert sea.host(1).say(b"AT?BV\n") == ["24.1000"]
    assert len([each for each in sea.outputs if isinstance(each[1], PortBytes)]) == 9


def test_stale_bytes_come_first() -> None:
    host = sea_with(FaultKind.STALE).host(1)
    assert len(host.lines()) == 1
    assert host.say(b"AT?AL\n") == ["1"]


def test_connections_drop_and_modems_reset_at_their_instant() -> None:
    sea = sea_with(FaultKind.DROP_CONNECTION, 1.0, modem=1)
    one, two, serial = sea.host(1), sea.host(2), sea.host(1, is_serial=True)
    sea.run(1.0)
    assert (one.is_closed, two.is_closed, serial.is_closed) == (True, False, False)
    assert sea.host(1).say(b"AT?AL\n") == ["1"]
    sea = sea_with(FaultKind.RESET, 2.0, modem=1)
    host = sea.host(1)
    sea.run(2.0)
    assert host.is_closed
    assert any(isinstance(output, ModemDown) for _, output in sea.outputs)
    sea.run(6.0)
    assert sea.fleet.is_up(1)


def test_rates_hold_between_their_instants_only() -> None:
    plan = FaultPlan(rates={FaultKind.LOST_REPLY: 1.0}, from_s=1.0, until_s=2.0)
    sea = Sea(faults=plan)
    host = sea.host(1)
    answers = []
    for at_s in (0.9, 1.0, 1.9, 2.0):
        sea.run(at_s)
        answers.append(len(host.say(b"AT?AL\n")))
    assert answers == [1, 0, 0, 1]


def chatter(seed: int, rate: float, interpreter: Interpreter) -> tuple[list[object], Sea]:
    """Let two modems talk under all faults at once."""
    rates = dict.fromkeys(FaultKind, rate)
    sea = Sea(
        spacing_m=150.0,
        faults=FaultPlan(seed=seed, rates=rates, until_s=60.0),
        settings={"ZX": 1, "ZU": 1},
        interpreter=interpreter,
    )
    prefix = b"+++" if interpreter is Interpreter.AT else b""
    hosts = {address: sea.host(address) for address in (1, 2)}
    for step in range(60):
        sea.run(step * 1.0)
        for address, host in hosts.items():
            if host.is_closed and sea.fleet.is_up(address):
                hosts[address] = host = sea.host(address)
            host.say(prefix + b"AT*SENDIM,3,%d,ack,%03d\n" % (3 - address, step))
            host.say(prefix + b"AT*SEND,3,%d,%03d\n" % (3 - address, step))
            host.say(prefix + b"AT?DI\n")
    sea.run(200.0)
    return list(sea.outputs), sea


@pytest.mark.parametrize("interpreter", list(Interpreter))
def test_one_seed_gives_one_course_and_another_seed_another(interpreter: Interpreter) -> None:
    first, _ = chatter(1, 0.05, interpreter)
    assert first == chatter(1, 0.05, interpreter)[0]
    assert first != chatter(2, 0.05, interpreter)[0]


def test_after_all_faults_the_fleet_works_as_before() -> None:
    for seed in range(3):
        _, sea = chatter(seed, 0.1, Interpreter.NET)
        near, far = sea.host(1), sea.host(2)
        near.say(IM)
        sea.run()
        assert near.all_of(DeliveredIm) == [DeliveredIm(2)]
        assert [m.payload for m in far.all_of(RecvIm)] == [b"hello"]
        assert near.all_of(SendEnd)


def test_plan_is_read_from_a_mapping_and_typos_are_named() -> None:
    plan = plan_from_mapping(
        {
            "seed": 7,
            "rates": {"lost_reply": 0.05},
            "script": [{"kind": "reset", "at_s": 30, "modem": 1}],
        },
        source="faults.json5",
    )
    assert plan.rates == {FaultKind.LOST_REPLY: 0.05}
    assert plan.script[0].kind is FaultKind.RESET
    for wrong in (
        {"rates": {"lost_repli": 0.1}},
        {"rates": {"busy": 2}},
        {"script": [{"kind": "reset"}]},
        {"sead": 1},
    ):
        with pytest.raises(ConfigError, match=r"faults\.json5: "):
            plan_from_mapping(wrong, source="faults.json5")


@pytest.mark.parametrize("spares", [False, True])
@pytest.mark.parametrize(
    "kind",
    [FaultKind.HALF_LINE, FaultKind.WRONG_LENGTH, FaultKind.CORRUPT],
    ids=lambda each: each.value,
)
def test_damage_strikes_messages_unless_they_are_spared(kind: FaultKind, spares: bool) -> None:
    plan = FaultPlan(rates={kind: 1.0}, from_s=0.01, spares_payloads=spares)
    sea = Sea(spacing_m=15.0, faults=plan)
    near, far = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,5,2,noack,hello\n")
    sea.run()
    assert (b",hello\r\n" in far.raw and b"RECVIM,5,1,2,noack," in far.raw) is spares
    sea.wait(1.0)
    near.say(b"AT?AL\n")
    is_whole = sea.outputs[-1][1] == PortBytes(near.port_id, b"1\r\n")
    assert is_whole is (kind is FaultKind.WRONG_LENGTH)
