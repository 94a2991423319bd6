"""What the driver's encoder does not write, the emulated modem refuses: both ask the same table."""

import pytest

from tests.links.evologics.emulator.sea import Sea
from zacoustic_evologics import SETTINGS, CommandDecoder, encode_command
from zacoustic_evologics.at.commands import Command, InvalidCommand
from zacoustic_evologics.at.messages import RawData

REFUSED = (
    b"AT*SENDIM,0,2,ack,",
    b"AT*SENDIM,65,2,ack," + bytes(65),
    b"AT*SENDIM,1,0,noack,x",
    b"AT*SENDIM,1,256,noack,x",
    b"AT*SENDIM,1,255,ack,x",
    b"AT*SENDIM,p8,1,2,ack,x",
    b"AT*SENDIMS,65,2,," + bytes(65),
    b"AT*SENDPBM,1,255,x",
    b"AT*SENDPBM,65,2," + bytes(65),
    b"AT*SEND,0,2,",
    b"AT*SEND,1,255,x",
    b"AT*SEND,1025,2," + bytes(1025),
    *(b"AT%s%s%d" % (each.prefix.encode(), each.name.encode(), each.high + 1)
      for each in SETTINGS.values()),
)  # fmt: skip


def read(raw: bytes) -> Command:
    """Return a command as a modem reads it: each of these is one, of values beyond the limits."""
    (command,) = CommandDecoder().feed(raw + b"\n")
    assert not isinstance(command, InvalidCommand | RawData)
    return command


@pytest.mark.parametrize("raw", REFUSED, ids=lambda raw: raw[:24].decode())
def test_command_that_the_driver_does_not_write_is_refused_by_the_modem(raw: bytes) -> None:
    with pytest.raises(ValueError, match="allowed"):
        encode_command(read(raw))
    (answer,) = Sea(settings={"ZF": 1}).host(1).say(raw + b"\n")
    assert answer.startswith("ERROR ")


def test_command_at_the_limits_is_written_and_accepted() -> None:
    host = Sea(settings={"ZF": 1}).host(1)
    for raw in (b"AT*SENDPBM,p7,64,2," + bytes(64), b"AT*SEND,1024,2," + bytes(1024), b"AT!ZC255"):
        assert encode_command(read(raw)) == raw + b"\n"
        assert host.say(raw + b"\n") == ["OK"]
