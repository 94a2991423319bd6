import pytest

from zacoustic.channel.profiles import PROFILES, ModemProfile, profile_named
from zacoustic.errors import ConfigError


def test_instant_messages_take_the_published_time() -> None:
    modem = PROFILES["evologics_s2c_18_34"]
    assert 0.8603 < modem.airtime_s(64) < 0.8605
    cycle_s = modem.airtime_s(64) + modem.gap_s
    assert round(cycle_s, 3) == 0.951
    assert round(64 * 8 / cycle_s) == 539
    # The line is within 14 ms of every published point.
    for frame_bytes, published_s in (
        (1, 0.172102),
        (8, 0.237660),
        (16, 0.327796),
        (32, 0.499859),
        (64, 0.860338),
    ):
        assert modem.airtime_s(frame_bytes) == pytest.approx(published_s, abs=0.014)


def test_micromodem_packet_of_192_bytes_takes_the_published_time() -> None:
    assert PROFILES["whoi_micromodem_psk6"].airtime_s(192) == pytest.approx(3.25)


def test_m64_moves_64_bits_a_second_each_way() -> None:
    modem = PROFILES["waterlinked_m64"]
    assert modem.airtime_s(8) + modem.gap_s == pytest.approx(1.0)
    assert modem.airtime_s(8) == pytest.approx(0.5)


@pytest.mark.parametrize(("cargo_bytes", "airtime_s"), [(16, 2.8), (64, 7.6), (480, 49.2)])
def test_janus_cargo_takes_the_published_time(cargo_bytes: int, airtime_s: float) -> None:
    assert PROFILES["janus"].airtime_s(cargo_bytes) - 0.1 == pytest.approx(airtime_s - 0.1)


def test_nanomodem_reaches_463_bits_a_second_with_full_frames() -> None:
    modem = PROFILES["nanomodem"]
    assert modem.mtu_bytes * 8 / modem.airtime_s(modem.mtu_bytes) == pytest.approx(463.0)


def test_ideal_modem_takes_no_time_to_speak_of() -> None:
    modem = PROFILES["ideal"]
    assert modem.mtu_bytes == 512
    assert modem.airtime_ns(512) == 4096
    assert (modem.gap_ns, modem.half_duplex) == (0, False)
    assert modem.frame_error_rate(-1000.0, 512) == 0.0


@pytest.mark.parametrize("modem", PROFILES.values(), ids=PROFILES.keys())
def test_every_profile_is_consistent(modem: ModemProfile) -> None:
    assert profile_named(modem.name) is modem
    assert modem.mtu_bytes >= 1
    assert modem.preamble_s >= 0.0
    assert modem.gap_s >= 0.0
    assert modem.range_m > 0.0
    assert modem.origin
    assert modem.bandwidth_hz < 2.0 * modem.frequency_hz
    more_s = modem.airtime_s(modem.mtu_bytes) - modem.airtime_s(modem.mtu_bytes - 1)
    assert 8.0 / more_s == pytest.approx(modem.bit_rate_bps, rel=1e-6)
    assert modem.airtime_ns(modem.mtu_bytes) == round(modem.airtime_s(modem.mtu_bytes) * 1e9)
    assert modem.overlaps_band_of(modem)
    loud, faint = modem.frame_error_rate(40.0, 8), modem.frame_error_rate(-40.0, 8)
    assert loud < 1e-6
    assert faint > 0.9 or modem.name == "ideal"


def test_bands_that_do_not_touch_do_not_disturb() -> None:
    assert not PROFILES["janus"].overlaps_band_of(PROFILES["evologics_s2c_18_34"])
    assert PROFILES["nanomodem"].overlaps_band_of(PROFILES["evologics_s2c_18_34"])


def test_an_unknown_profile_is_an_error_that_lists_the_names() -> None:
    with pytest.raises(ConfigError, match=r"profile is 's2c'; allowed: ahoi, .*ideal"):
        profile_named("s2c")
