"""HIGH_LATENCY2 as a value and back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.mavlink.messages import ARMED_GUIDED, PX4, report
from zacoustic.config import config_from_mapping
from zacoustic.core.values.payload import PackedCodec
from zacoustic.mavlink.dialect import Message, PacketCodec
from zacoustic.mavlink.entries import CLOCK, TELEMETRY, entries
from zacoustic.mavlink.telemetry import heartbeat, heartbeat_of, message_of, value_of

_BYTE, _SIGNED, _WORD = st.integers(0, 255), st.integers(-128, 127), st.integers(0, 65535)
_DIRECTION = st.integers(0, 179)
_FIELDS = {
    "timestamp": st.integers(0, 4_294_967).map(lambda seconds: seconds * 1000),
    "type": _BYTE, "autopilot": _BYTE, "custom_mode": _WORD,
    "latitude": st.integers(-90_000_000, 90_000_000).map(lambda step: step * 10),
    "longitude": st.integers(-180_000_000, 180_000_000).map(lambda step: step * 10),
    "altitude": st.integers(-32768, 32767), "target_altitude": st.integers(-32768, 32767),
    "heading": _DIRECTION, "target_heading": _DIRECTION, "wind_heading": _DIRECTION,
    "target_distance": _WORD, "throttle": _BYTE, "airspeed": _BYTE, "airspeed_sp": _BYTE,
    "groundspeed": _BYTE, "windspeed": _BYTE, "eph": _BYTE, "epv": _BYTE,
    "temperature_air": _SIGNED, "climb_rate": _SIGNED, "battery": st.integers(-1, 127),
    "wp_num": _WORD, "failure_flags": _WORD, "custom0": _SIGNED, "custom1": _SIGNED,
    "custom2": _SIGNED,
}  # fmt: skip


def telemetry_codec() -> PackedCodec:
    made = entries("auv1/mavlink", vehicle=2, shore=1, first_id=60)
    table = config_from_mapping({"address": 1, **made}, source="test").table
    (found,) = (each.type for each in table if each.name.endswith(TELEMETRY))
    assert found is not None
    return PackedCodec(found)


CODEC = telemetry_codec()


@given(st.fixed_dictionaries(_FIELDS))
def test_every_report_crosses_and_comes_out_as_it_was(fields: dict[str, int]) -> None:
    sent = Message("HIGH_LATENCY2", fields)
    value = value_of(sent, ARMED_GUIDED, 1) | {CLOCK: 4_000_000_000}
    crossed = CODEC.decode(CODEC.encode(value))
    assert crossed[CLOCK] == 4_000_000_000
    assert message_of(crossed).fields == fields


def test_what_is_not_known_crosses_as_missing() -> None:
    value = value_of(report(latitude=2**31 - 1, longitude=-(2**31), battery=-1), ARMED_GUIDED, 7)
    assert (value["latitude"], value["longitude"], value["battery"]) == (None, None, None)
    back = message_of(value).fields
    assert (back["latitude"], back["longitude"], back["battery"]) == (2**31 - 1, 2**31 - 1, -1)


def test_the_heartbeat_on_shore_is_that_of_the_autopilot() -> None:
    value = value_of(report(), ARMED_GUIDED, 7)
    assert heartbeat_of(value) == ARMED_GUIDED


def test_px4_has_the_upper_half_of_its_mode_in_a_report() -> None:
    armed = heartbeat(12, PX4, base_mode=209, custom_mode=0x04030000)
    value = value_of(report(autopilot=PX4, custom_mode=0x0403), armed, 1)
    assert heartbeat_of(value) == armed


def test_damage_and_unknown_packets_are_skipped() -> None:
    packet = PacketCodec().pack(report(), system=7, component=1)
    damaged = bytearray(packet)
    damaged[20] ^= 0xFF
    stream = b"\x00\xff" + bytes(damaged) + packet + b"rubbish" + packet
    whole = PacketCodec().feed(stream)
    single = PacketCodec()
    piecewise = [each for byte in stream for each in single.feed(bytes([byte]))]
    assert [each.message for each in whole] == [report()] * 2
    assert piecewise == whole
    assert (whole[-1].system, whole[-1].component) == (7, 1)


def test_a_damaged_datagram_takes_no_other_along() -> None:
    codec = PacketCodec()
    packet = codec.pack(report(), system=7, component=1)
    assert codec.feed(b"\xfe\xfd" + packet, is_whole=True) == []
    assert len(codec.feed(packet, is_whole=True)) == 1


def test_a_value_that_no_message_has_is_named() -> None:
    with pytest.raises(ValueError, match="HIGH_LATENCY2"):
        PacketCodec().pack(report(throttle=300), system=1, component=1)
