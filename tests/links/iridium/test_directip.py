"""DirectIP: its bytes, and the shore with a gateway that repeats, errs or is not there."""

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.iridium.harness import CONFIG, sea_and_shore
from tests.runtime.loop_checks import run
from zacoustic.core.linktypes import LinkState, Transmission, TransmitOutcome
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link import registry
from zacoustic.testing.linkpair import RecordingReceiver
from zacoustic_iridium.directip import Confirmed, ForModem, FromModem, decode, encode
from zacoustic_iridium.emulator.fleet import FIRST_IMEI
from zacoustic_iridium.onshore import ShoreLink

IMEI = str(FIRST_IMEI)
MESSAGES = [
    FromModem(IMEI, 7, 0, b"report"),
    FromModem(IMEI, 8, 0, b""),
    ForModem(IMEI, 3, b"order"),
    Confirmed(3, 1),
    Confirmed(3, -5),
]


@pytest.mark.parametrize("message", MESSAGES)
def test_messages_are_what_they_were(message: FromModem | ForModem | Confirmed) -> None:
    assert decode(encode(message)) == message


def test_bytes_of_a_message_from_a_modem() -> None:
    encoded = encode(FromModem("300234010000001", 258, 0, b"hi"), session_time=1)
    assert encoded == (
        bytes.fromhex("01 0024 01 001c 00000000") + b"300234010000001"
        + bytes.fromhex("00 0102 0000 00000001 02 0002") + b"hi"
    )  # fmt: skip


@given(st.binary(max_size=120))
def test_any_bytes_are_decoded_or_refused(tail: bytes) -> None:
    for head in (b"", b"\x01", b"\x01" + len(tail).to_bytes(2, "big")):
        decode(head + tail)


def test_what_comes_twice_is_handed_on_once_and_strangers_are_not_heard() -> None:
    async def main() -> None:
        server, sea, shore = await sea_and_shore()
        receiver = RecordingReceiver()
        await shore.open(receiver)
        for message in (
            FromModem(IMEI, 1, 0, b"one"),
            FromModem(IMEI, 1, 0, b"one"),
            FromModem("300234010000099", 2, 0, b"a stranger"),
            FromModem(IMEI, 3, 13, b"cut sh"),
            FromModem(IMEI, 3, 0, b"cut short no more"),
            FromModem(IMEI, 4, 0, b""),
            Confirmed(1, 1),
        ):
            await _deliver(shore, encode(message))
        await _deliver(shore, b"\x01\xff\xff nonsense")
        await _deliver(shore, b"\x01\x00\x09\x01")
        await _deliver(shore, encode(FromModem(IMEI, 5, 0, b"the last one")))
        await receiver.wait("three", lambda: len(receiver.frames) == 3, 10.0)
        assert [each.frame_bytes for each in receiver.frames] == [
            b"one",
            b"cut short no more",
            b"the last one",
        ]
        await shore.close()
        await sea.close()
        await server.close()

    run(main())


async def _deliver(shore: ShoreLink, encoded: bytes) -> None:
    """Deliver as the gateway does; returns when the shore has closed the connection."""
    reader, writer = await asyncio.open_connection("127.0.0.1", shore.port)
    writer.write(encoded)
    writer.write_eof()
    await reader.read()
    writer.close()


def test_a_gateway_that_is_gone_or_refuses_is_told() -> None:
    async def main() -> None:
        server, sea, shore = await sea_and_shore()
        receiver = RecordingReceiver()
        await shore.open(receiver)
        for number in range(51):  # so many wait for a modem at most
            server.gateway.queue(IMEI, b"%d" % number)
        shore.transmit(Transmission(transmission_id=1, frame_bytes=b"one too many"))
        await receiver.wait("a refusal", lambda: receiver.reports, 10.0)
        assert receiver.reports[0].outcome is TransmitOutcome.REJECTED
        await server.close()
        shore.transmit(Transmission(transmission_id=2, frame_bytes=b"nobody"))
        await receiver.wait("a report", lambda: len(receiver.reports) == 2, 30.0)
        assert receiver.reports[1].outcome is TransmitOutcome.ABORTED
        assert shore.diagnostics()["spent_bytes"] == 0
        await shore.close()
        await sea.close()

    run(main())


def test_a_port_in_use_is_an_error_and_may_be_tried_again() -> None:
    async def main() -> None:
        server, sea, shore = await sea_and_shore()
        await shore.open(RecordingReceiver())
        second = ShoreLink(f"directip:127.0.0.1:{shore.port}", shore._config)
        with pytest.raises(LinkOpenError):
            await second.open(RecordingReceiver())
        await shore.close()
        receiver = RecordingReceiver()
        await second.open(receiver)
        assert receiver.states[-1][0] is LinkState.UP
        await second.close()
        await sea.close()
        await server.close()

    run(main())


@pytest.mark.parametrize(
    ("locator", "said"),
    [
        ("iridium/serial:/dev/ttyUSB0", "max_bytes_per_day is missing"),
        ("iridium/ttyUSB0#max_bytes_per_day=100", "serial:PORT, tcp:HOST:PORT"),
        (
            "iridium/serial:/dev/x#max_bytes_per_day=100&mtu=400",
            "mtu is '400'; allowed: ",
        ),
        ("iridium/serial:/dev/x#max_bytes_per_day=100&imei=1", "are for directip"),
        (
            "iridium/serial:/dev/x#max_bytes_per_day=100&give_up_s=inf",
            "give_up_s is 'inf'",
        ),
        ("iridium/serial:/dev/x#max_bytes_per_day=100&session_s=nan", "session_s is 'nan'"),
        (
            "iridium/serial:/dev/x#max_bytes_per_day=100&price=inf",
            "price is 'inf'",
        ),
        ("iridium/directip:127.0.0.1:1#max_bytes_per_day=100", "gateway is ''"),
        (
            "iridium/directip:127.0.0.1:1#max_bytes_per_day=100&gateway=a:1&imei=12",
            "imei is '12'; allowed: 15 digits",
        ),
        ("iridium/directip:1#max_bytes_per_day=100&gateway=a:1", "allowed: HOST:PORT"),
    ],
)
def test_mistakes_are_named(locator: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        registry.create(locator, 1)
    assert said in str(caught.value)


def test_a_plain_locator_makes_a_modem_link() -> None:
    link = registry.create("iridium/tcp:127.0.0.1:9#max_bytes_per_day=5000&price=0.16", 1)
    assert link.capabilities.mtu_bytes == CONFIG.mtu
    assert link.diagnostics()["spent_money"] == 0
