"""The driver of SBD modems against the emulated one, in virtual time: nothing twice, nothing free.

The oracle is the gateway: what it has, how often, and what it charges.
"""

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.iridium.sea import Host, run
from zacoustic.channel.agenda import Agenda
from zacoustic_iridium.emulator.gateway import EmulatedGateway
from zacoustic_iridium.emulator.isu import IsuFaults
from zacoustic_iridium.sbd import STATUS_WORDS, checked, session_in, take_message

OTHER = "300234010000002"


def test_the_sum_is_that_of_the_manual() -> None:
    assert checked(b"hello") == bytes.fromhex("68656c6c6f0214")
    assert take_message(bytes.fromhex("000568656c6c6f0214")) == (b"hello", 9)
    assert take_message(bytes.fromhex("00000000")) == (b"", 4)
    assert take_message(bytes.fromhex("000568656c6c6f0215")) == (None, 9)
    assert take_message(bytes.fromhex("000568656c6c6f02")) is None


def test_a_session_line() -> None:
    session = session_in("+SBDIX: 0, 12, 1, 7, 30, 2")
    assert session is not None
    assert (session.sent, session.sent_number, session.received, session.waiting) == (0, 12, 1, 2)
    assert session_in("+SBDIX: 0, 12") is None


def test_a_frame_goes_and_an_answer_comes() -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    sea, shore = Host(agenda, gateway), Host(agenda, gateway, OTHER, seed=2)
    run(agenda, 5)
    assert (sea.readies, shore.readies) == (1, 1)
    sea.send(b"report")
    run(agenda, 120)
    assert [each.is_sent for each in sea.ended] == [True]
    assert shore.arrived == [b"report"]
    shore.send(b"order")
    run(agenda, 120)
    assert sea.arrived == [b"order"]


def test_idle_costs_nothing() -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway)
    run(agenda, 86_400)
    assert (gateway.paid_bytes, host.modem.sessions) == (0, 0)


def test_a_look_now_and_then_where_nothing_rings() -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway, check_s=600.0)
    run(agenda, 4000)
    assert host.modem.sessions == 6
    assert gateway.paid_bytes == host.budget.spent_bytes == 50 * host.modem.sessions


@pytest.mark.parametrize("status", sorted(STATUS_WORDS))
def test_every_status_word(status: int) -> None:
    """Two of three sessions fail; the frame goes nevertheless, once."""
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway, faults=IsuFaults(statuses={status: 0.66}), give_up_s=3600.0)
    run(agenda, 5)
    host.send(b"report")
    run(agenda, 3600)
    assert [each.is_sent for each in host.ended] == [True]
    assert [each.data for each in gateway.messages] == [b"report"]
    host.isu.faults = IsuFaults(statuses={status: 1.0})
    host.send(b"another one")
    run(agenda, 4000)
    assert not host.ended[-1].is_sent
    assert str(status) in host.ended[-1].detail
    assert len(gateway.messages) == 1


def test_whatever_goes_wrong_nothing_is_doubled_and_little_paid_in_vain(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(1000)):
        rng = random.Random(seed)
        faults = IsuFaults(
            statuses={32: 0.3, 13: 0.02, 35: 0.05}, breaks_after=0.03, mute=0.02, mute_after=0.02
        )
        agenda, gateway = Agenda(), EmulatedGateway()
        host = Host(agenda, gateway, faults=faults, seed=seed, give_up_s=3600.0)
        run(agenda, 5)
        sent = []
        for number in range(20):
            frame = b"frame %d " % number + rng.randbytes(rng.choice((1, 40, 90, 250)))
            sent.append(frame)
            host.send(frame)
            run(agenda, rng.uniform(1.0, 60.0))
            if rng.random() < 0.2:
                host.cut_power()
            run(agenda, 4000)
            assert len(host.ended) == number + 1, f"seed {seed}: it does not end"
        assert all(each.is_sent for each in host.ended), f"seed {seed}"
        # What comes again has the number of the first, by which the shore knows it.
        unique = {each.number: each.data for each in gateway.messages}
        assert list(unique.values()) == sent, f"seed {seed}"


def test_bytes_paid_and_bytes_needed(count: Callable[[int], int]) -> None:
    paid = needed = 0
    for seed in range(count(400)):
        faults = IsuFaults(statuses={32: 0.4, 35: 0.05}, breaks_after=0.03)
        agenda, gateway = Agenda(), EmulatedGateway()
        host = Host(agenda, gateway, faults=faults, seed=seed, give_up_s=3600.0)
        run(agenda, 5)
        for size in (30, 50, 51, 200, 270):
            host.send(bytes(size))
            run(agenda, 4000)
            needed += -(-size // 50) * 50
        paid += gateway.paid_bytes
        assert host.budget.spent_bytes == gateway.paid_bytes
    assert paid <= 1.1 * needed


def test_nothing_is_sent_beyond_the_budget() -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway, most_bytes=120)
    run(agenda, 5)
    for _ in range(4):
        host.send(bytes(50))
        run(agenda, 400)
    assert [each.is_sent for each in host.ended] == [True, True, False, False]
    assert host.ended[-1].detail == "the budget of the day is spent"
    assert gateway.paid_bytes == 100
    run(agenda, 86_400)
    host.send(bytes(50))
    run(agenda, 400)
    assert host.ended[-1].is_sent


def test_a_frame_that_cannot_go_is_given_up_in_time() -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway, faults=IsuFaults(statuses={32: 1.0}), give_up_s=200.0)
    run(agenda, 5)
    began_at = agenda.now
    host.send(b"report")
    while not host.ended:
        run(agenda, 1)
    assert "no network" in host.ended[0].detail
    assert (agenda.now - began_at) / 1e9 < 260.0


def test_a_modem_that_falls_silent_is_set_up_again() -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway, faults=IsuFaults(mute=1.0), give_up_s=1200.0)
    run(agenda, 5)
    host.send(b"report")
    run(agenda, 200)
    assert host.silences
    host.isu.faults = IsuFaults()
    run(agenda, 1000)
    assert host.readies >= 2
    assert host.ended[0].is_sent


@given(st.lists(st.binary(min_size=1, max_size=40), max_size=20), st.integers(0, 999))
def test_no_bytes_of_the_port_raise_or_stay(pieces: list[bytes], seed: int) -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway, seed=seed, give_up_s=1000.0)
    run(agenda, 5)
    host.send(b"report")
    for piece in pieces:
        host.modem.received(piece, agenda.now)
        host.serve()
        run(agenda, 3)
    run(agenda, 3000)
    host.send(b"then")
    run(agenda, 3000)
    assert host.ended[-1].is_sent
    assert b"then" in [each.data for each in gateway.messages]


def test_a_loop_of_rings_does_not_run_without_end() -> None:
    agenda, gateway = Agenda(), EmulatedGateway()
    host = Host(agenda, gateway)
    run(agenda, 5)
    for _ in range(100):
        host.modem.received(b"SBDRING\r\n", agenda.now)
        host.serve()
    run(agenda, 3600)
    assert host.modem.sessions < 10
