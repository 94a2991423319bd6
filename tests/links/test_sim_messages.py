import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.linktypes import LinkCapabilities, LinkMetrics, TransmitOutcome
from zacoustic_sim.messages import (
    MESSAGE_LIMIT_BYTES,
    Carrier,
    ClientMessage,
    Finished,
    Heard,
    Hello,
    MalformedMessageError,
    MessageDecoder,
    Refused,
    ServerMessage,
    Transmit,
    Welcome,
    encode_message,
)

SERVER_MESSAGES: list[ServerMessage] = [
    Welcome(LinkCapabilities(mtu_bytes=64, bit_rate_bps=480.5, reports=frozenset({"snr_db"})),
            "ahoi", 2.5),
    Refused("taken"),
    Finished(7, TransmitOutcome.SENT, lasted_ns=10**10, ago_ns=3, detail="x"),
    Heard(1, 255, bytes(range(256)), LinkMetrics(snr_db=3.5), damaged=True, ago_ns=1),
    Carrier(True),
]  # fmt: skip
CLIENT_MESSAGES: list[ClientMessage] = [Hello(1, 254), Transmit(2**40, 3, b""), Hello(1, 1)]


def test_messages_survive_any_cut_of_the_stream() -> None:
    stream = b"".join(encode_message(message) for message in SERVER_MESSAGES)
    rng = random.Random(3)
    for step in (len(stream), 1, 0, 0, 0):
        decoder = MessageDecoder[ServerMessage](ServerMessage)
        read: list[ServerMessage] = []
        rest = stream
        while rest:
            cut = step or rng.randint(1, 40)
            read += decoder.feed(rest[:cut])
            rest = rest[cut:]
        assert read == SERVER_MESSAGES


def test_messages_of_modems_are_read_as_such_only() -> None:
    stream = b"".join(encode_message(message) for message in CLIENT_MESSAGES)
    assert MessageDecoder[ClientMessage](ClientMessage).feed(stream) == CLIENT_MESSAGES
    with pytest.raises(MalformedMessageError):
        MessageDecoder[ServerMessage](ServerMessage).feed(stream)


@given(st.binary(max_size=300))
def test_nonsense_is_a_malformed_message_or_not_yet_one(nonsense: bytes) -> None:
    for stream in (
        nonsense,
        b"\x5a\x5e" + nonsense,
        b"\x5a\x5e" + len(nonsense).to_bytes(2, "big") + nonsense,
    ):
        decoder = MessageDecoder[ClientMessage](ClientMessage)
        try:
            decoder.feed(stream)
        except MalformedMessageError:
            continue
        assert len(decoder._buffer) <= len(stream)


def test_capabilities_out_of_range_are_malformed() -> None:
    welcome = encode_message(
        Welcome(LinkCapabilities(mtu_bytes=64, bit_rate_bps=480.0), "ahoi", 1.0)
    )
    wrong = welcome.replace(b"mtu_bytes\x40", b"mtu_bytes\x07")
    assert wrong != welcome
    with pytest.raises(MalformedMessageError, match="mtu_bytes is 7"):
        MessageDecoder[ServerMessage](ServerMessage).feed(wrong)


def test_message_that_is_too_long_is_not_made() -> None:
    with pytest.raises(MalformedMessageError, match="allowed: 65535"):
        encode_message(Transmit(1, 255, bytes(MESSAGE_LIMIT_BYTES)))
