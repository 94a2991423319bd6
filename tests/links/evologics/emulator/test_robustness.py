"""Whatever hosts say: nothing crashes, everything stays bounded, all that is said can be read."""

import random
from collections.abc import Callable

import pytest

from tests.links.evologics.emulator.sea import Sea
from zacoustic_evologics import SETTINGS, Interpreter
from zacoustic_evologics.emulator import Behaviour, ModemDown, PortClosed

NAMES = [*SETTINGS, "S", "DI", "PC", "T", "E", "I", "V", "P", "CLOCK", "UP", "NOISE", "ZSL", "XX"]
PIECES = [b"AT", b"*SENDIM,", b"+++", b"+++AT", b"\n", b"\r", b",", b"5", b"ack", b"?", b"!", b"Z0"]


def command(rng: random.Random) -> bytes:
    """Draw a command, valid more often than not."""
    payload = rng.randbytes(rng.choice((0, 1, 5, 64, 65, 300)))
    destination = rng.choice((1, 2, 3, 3, 2, 255, 0, 77))
    pid = rng.choice((b"", b"", b"p0,", b"p3,", b"p9,"))
    length = len(payload) + rng.choice((0, 0, 0, 0, 1, -1))
    match rng.randrange(10):
        case 0 | 1:
            flag = rng.choice((b"ack", b"noack", b"force", b"maybe"))
            text = b"*SENDIM,%s%d,%d,%s,%s" % (pid, length, destination, flag, payload)
        case 2:
            at = rng.choice((b"", b"%d" % rng.randrange(2**32)))
            text = b"*SENDIMS,%s%d,%d,%s,%s" % (pid, length, destination, at, payload)
        case 3:
            text = b"*SENDPBM,%s%d,%d,%s" % (pid, length, destination, payload)
        case 4:
            text = b"*SEND,%s%d,%d,%s" % (pid, length, destination, payload)
        case 5:
            text = b"?" + rng.choice(NAMES).encode()
        case 6:
            text = b"%s%s%d" % (rng.choice((b"!", b"@")), rng.choice(NAMES).encode(),
                                rng.choice((0, 1, 2, 3, 14, 1500, 9000)))  # fmt: skip
        case 7:
            letters = b"A C D2 H1 I1 N O P S Z1 Z3 Z4 Z0 &V &W &F ?S$ %SYNC,1 *SENDPROBE,1,0,"
            text = rng.choice(letters.split())
        case 8:
            return b"".join(rng.choice(PIECES) for _ in range(rng.randrange(12)))
        case _:
            return rng.randbytes(rng.randrange(200))
    return rng.choice((b"AT", b"+++AT")) + text + rng.choice((b"\n", b"\r", b"\r\n"))


@pytest.mark.parametrize("interpreter", list(Interpreter))
@pytest.mark.parametrize("second_im", ["busy", "cancel"])
def test_random_hosts_never_crash_a_fleet(
    count: Callable[[int], int], interpreter: Interpreter, second_im: str
) -> None:
    behaviour = Behaviour(
        second_im="busy" if second_im == "busy" else "cancel",
        while_receiving="busy" if second_im == "busy" else "wait",
    )
    for seed in range(count(300)):
        rng = random.Random(seed)
        sea = Sea(3, spacing_m=120.0, interpreter=interpreter, behaviour=behaviour)
        hosts = [sea.host(address) for address in (1, 2, 3)]
        for _ in range(400):
            place = rng.randrange(3)
            if hosts[place].is_closed:
                if not sea.fleet.is_up(place + 1):
                    sea.wait(1.0)
                    continue
                hosts[place] = sea.host(place + 1)
            hosts[place].say(command(rng))
            if rng.random() < 0.3:
                sea.wait(rng.random() * 2.0)
        assert sea.fleet.remembered < 500
        sea.wait(300.0)
        assert sea.fleet.remembered < 30


def test_random_bytes_are_answered_or_ignored(count: Callable[[int], int]) -> None:
    rng = random.Random(1)
    for interpreter in Interpreter:
        sea = Sea(interpreter=interpreter)
        host = sea.host(1)
        for _ in range(count(20_000)):
            host.say(rng.randbytes(rng.randrange(500)))
            host.heard.clear()
            sea.outputs.clear()
            sea.wait(0.1)
        sea.wait(300.0)
        assert sea.fleet.remembered < 30


def test_valid_commands_are_answered_in_a_grammar_that_is_read_without_a_gap() -> None:
    for interpreter in Interpreter:
        prefix = b"+++" if interpreter is Interpreter.AT else b""
        sea = Sea(3, spacing_m=120.0, interpreter=interpreter, settings={"ZX": 1, "ZU": 1, "RP": 1})
        hosts = [sea.host(address) for address in (1, 2, 3)]
        rng = random.Random(5)
        for _ in range(600):
            text = b"AT*" + command(rng).removeprefix(b"+++").removeprefix(b"AT*")
            if text.startswith(b"AT*SEND") and b"Z0" not in text:
                length = text.count(b",")
                payload = rng.randbytes(1 + length)
                kind = rng.choice((b"SENDIM,%d,%d,ack,", b"SENDPBM,%d,%d,", b"SEND,%d,%d,"))
                header = kind % (len(payload), rng.choice((1, 2, 3)))
                rng.choice(hosts).say(prefix + b"AT*" + header + payload + b"\n")
            rng.choice(hosts).say(prefix + b"AT?" + rng.choice(NAMES).encode() + b"\n")
            sea.wait(rng.random())
        sea.run(2000.0)
        assert sea.unrecognised() == []
        assert not any(isinstance(each, ModemDown | PortClosed) for _, each in sea.outputs)


def test_memory_stays_bounded_over_a_long_exchange() -> None:
    sea = Sea(settings={"ZX": 1})
    hosts = [sea.host(1), sea.host(2)]
    highest = 0
    for number in range(1500):
        hosts[number % 2].say(b"AT*SENDIM,1,%d,ack,x\n" % (2 - number % 2))
        sea.wait(2.6)
        highest = max(highest, sea.fleet.remembered)
        sea.outputs.clear()
        for host in hosts:
            host.heard.clear()
    assert highest < 20
