import itertools

import pytest

from zacoustic.channel.profiles import PROFILES, ModemProfile
from zacoustic.channel.propagation.fading import FadingProcess
from zacoustic.channel.propagation.randomness import direction_random
from zacoustic.channel.propagation.sea import SEA_FADING, ChannelModel, SeaChannel, create_channel
from zacoustic.errors import ConfigError

S2C = PROFILES["evologics_s2c_18_34"]


def _channel(name: str, modem: ModemProfile = S2C, wind_m_s: float = 5.0) -> ChannelModel:
    return create_channel(name, modem, wind_m_s=wind_m_s, shipping=0.5)


def _drawn_loss(channel: ChannelModel, distance_m: float) -> float:
    """Share of frames lost over 200 seeds of 50 frames, one every two seconds."""
    mean_db = channel.effective_snr_db(distance_m)
    lost = 0
    for seed in range(200):
        rng = direction_random(seed, 1, 2, "water")
        fades = FadingProcess(SEA_FADING, rng)
        for index in range(50):
            gain_db = fades.next_gain_db(index * 2_000_000_000)
            lost += rng.random() < channel.frame_error_rate(mean_db + gain_db, 64)
    return lost / 10_000


@pytest.mark.parametrize(
    ("distance_m", "share", "margin"), [(1500.0, 0.10, 0.02), (3500.0, 0.50, 0.05)]
)
def test_the_sea_loses_a_tenth_at_1500_m_and_half_at_3500_m(
    distance_m: float, share: float, margin: float
) -> None:
    channel = _channel("sea")
    assert channel.mean_frame_error_rate(distance_m, 64) == pytest.approx(share, abs=margin)
    assert _drawn_loss(channel, distance_m) == pytest.approx(share, abs=margin)


def test_the_sea_gets_worse_with_range_with_length_and_with_wind() -> None:
    channel = _channel("sea")
    rates = [channel.mean_frame_error_rate(distance, 64) for distance in range(100, 9000, 300)]
    assert all(near <= far for near, far in itertools.pairwise(rates))
    assert rates[0] < 0.01
    assert rates[-1] > 0.999
    assert channel.mean_frame_error_rate(2500.0, 8) < channel.mean_frame_error_rate(2500.0, 64)
    storm = _channel("sea", wind_m_s=15.0)
    assert storm.mean_frame_error_rate(2500.0, 64) > channel.mean_frame_error_rate(2500.0, 64)


@pytest.mark.parametrize("name", sorted(set(PROFILES) - {"ideal"}))
def test_every_modem_brings_half_of_its_frames_to_its_published_range(name: str) -> None:
    modem = PROFILES[name]
    channel = _channel("sea", modem)
    assert isinstance(channel, SeaChannel)
    frame_bytes = min(64, modem.mtu_bytes)
    assert channel.mean_frame_error_rate(modem.range_m, frame_bytes) == pytest.approx(0.5, abs=0.01)
    assert channel.mean_frame_error_rate(0.43 * modem.range_m, frame_bytes) < 0.15
    assert channel.implementation_loss_db > 5.0


def test_bare_formulae_lose_nothing_to_seven_kilometres() -> None:
    channel = _channel("awgn")
    for distance in range(0, 7001, 500):
        assert channel.mean_frame_error_rate(distance, 64) < 1e-9
    assert channel.mean_frame_error_rate(12_000.0, 64) > 0.99


def test_without_a_channel_nothing_is_lost_but_levels_fall() -> None:
    channel = _channel("none")
    assert channel.mean_frame_error_rate(100_000.0, 64) == 0.0
    assert channel.received_level_db(2000.0) < channel.received_level_db(1000.0)
    assert channel.detection_snr_db == float("-inf")


def test_desert_channel_uses_its_formulae() -> None:
    modem = PROFILES["evologics_s2c_7_17"]
    channel = _channel("desert", modem)
    near, far = (channel.mean_frame_error_rate(distance, 64) for distance in (8_000.0, 30_000.0))
    assert near < 1e-6
    assert far > 0.999


@pytest.mark.parametrize("name", ["sea", "awgn", "none", "desert"])
@pytest.mark.parametrize("distance_m", [0.0, 1.0, 1500.0, 1e6, 3e6])
def test_the_ideal_modem_loses_nothing_anywhere(name: str, distance_m: float) -> None:
    assert _channel(name, PROFILES["ideal"]).mean_frame_error_rate(distance_m, 512) == 0.0


@pytest.mark.parametrize("name", ["sea", "awgn", "none", "desert"])
def test_every_model_has_an_answer_at_any_distance(name: str) -> None:
    for modem in PROFILES.values():
        channel = _channel(name, modem)
        for distance in (0.0, 0.5, 1.0, 10.0, 1e4, 3e6):
            assert 0.0 <= channel.mean_frame_error_rate(distance, 1) <= 1.0


def test_an_unknown_channel_is_an_error_that_lists_the_names() -> None:
    words = "channel is 'air'; allowed: awgn, desert, none, recorded, sea"
    with pytest.raises(ConfigError, match=words):
        _channel("air")
