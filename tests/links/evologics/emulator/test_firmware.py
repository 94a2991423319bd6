"""What older firmwares say otherwise, and do not know."""

import pytest

from tests.links.evologics.emulator.sea import Sea
from zacoustic_evologics.at.firmware import Firmware
from zacoustic_evologics.at.notifications import Recv, RecvIm, RecvIms, RecvPbm
from zacoustic_evologics.emulator import Behaviour

EACH = pytest.mark.parametrize("firmware", ["1.6", "1.7", "1.8", "1.9"])


def sea_of(firmware: Firmware) -> Sea:
    return Sea(spacing_m=1500.0, behaviour=Behaviour(firmware=firmware), settings={"ZX": 1})


@EACH
def test_modem_says_which_it_is(firmware: Firmware) -> None:
    host = sea_of(firmware).host(1)
    assert host.say(b"ATI0\n") == [firmware]
    assert host.say(b"ATI1\n") == [f"phy:emulated 0.1, mac:d-mac v{firmware}"]


@EACH
def test_only_1_6_tells_bit_rate_and_delay_of_a_message(firmware: Firmware) -> None:
    sea = sea_of(firmware)
    near, far = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,1,2,ack,a\n")
    sea.run()
    near.say(b"AT*SENDPBM,1,2,b\n")
    far.say(b"AT*SENDIM,1,1,ack,c\n")
    sea.run()
    near.say(b"AT*SENDIM,1,2,noack,d\n")
    sea.run()
    first, last = far.all_of(RecvIm)
    is_old = firmware == "1.6"
    for record in (first, last, far.first(RecvPbm)):
        assert (record.bit_rate_bps is not None) is is_old
        assert (record.duration_us is None) is is_old
    # A one-way message measures no delay: what is told is that of the last exchange.
    assert first.propagation_us == (0 if is_old else None)
    assert last.propagation_us == (1_000_000 if is_old else None)
    assert sea.unrecognised() == []


@EACH
def test_other_records_are_those_of_all_firmwares(firmware: Firmware) -> None:
    sea = sea_of(firmware)
    near, far = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIMS,1,2,,a\n")
    sea.run()
    near.say(b"AT*SEND,1,2,b\n")
    sea.run()
    assert far.first(RecvIms).duration_us > 0
    assert far.first(Recv).propagation_us == 1_000_000


@EACH
def test_what_came_with_a_later_one_is_of_wrong_format(firmware: Firmware) -> None:
    host = sea_of(firmware).host(1)
    has_control, has_clock = firmware in ("1.8", "1.9"), firmware == "1.9"
    assert host.say(b"AT@CTRL\n") == ["OK" if has_control else "ERROR WRONG FORMAT"]
    assert host.say(b"AT!RI0\n") == ["OK"]
    assert host.say(b"AT@ZA1\n") == ["OK" if has_clock else "ERROR WRONG FORMAT"]
    assert host.say(b"AT?ZA\n") == ["1" if has_clock else "ERROR WRONG FORMAT"]
    misspelt = "IM Rerty Count: 0" in "\n".join(host.say(b"AT&V\n"))
    assert misspelt is not has_control
