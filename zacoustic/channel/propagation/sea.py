"""Five channel models with the same few methods.

``sea`` (the default)
    A receiver decodes the *direct path*: spherical spreading, absorption after Francois and
    A receiver decodes the *direct path*: spherical spreading, absorption after Francois and
    Garrison, Wenz's noise over the band. Two effects limit it, and both grow with range:

    - noise, by the sonar equation;
    - distortion: the same frame arrives over surface and bottom. The direct path decays as 20 log
      r, the trapped field of all the others as 10 log r, so their ratio falls by 10 log r at any
      source level.

    The two add up to one effective SNR, and each frame has its own fade (`fading`: Rician with
    K = 3, shadowing of 3 dB over 30 s). One rule fixes the scale, since no data sheet states the
    loss of a receiver against theory: *at its published range, in a wind of 5 m/s, a modem delivers
    half of the frames, and noise and distortion contribute equally*. For the S2C 18/34 and frames
    of 64 bytes that is a loss of 50 % at 3.5 km, about 10 % at 1.5 km, 2 % at 0.5 km and everything
    at 7 km; the resulting implementation loss is 16 dB. K, the deviation and the time are within
    the modellers' choices (K 3…10, 2…4 dB, tens of seconds).

``awgn``
    Practical spreading, the same absorption and noise, no fade, no implementation loss, no
    distortion: the ideal of the formulae. With it the S2C 18/34 loses nothing up to 7 km, so it is
    not the default.

``none``
    Without random losses. Levels are those of ``awgn``, so that collisions have an outcome.

``recorded``
    Mean level, noise and implementation loss of ``sea``; a recording has the fades and echoes
    (`recordedfades`).

``desert``
    The formulae of DESERT (see `desert`), BPSK without penalty, to compare with its runs.
"""

import functools
import math
from abc import ABC, abstractmethod
from typing import Final

from zacoustic.channel.formulae.acoustics import (
    PRACTICAL,
    SPHERICAL,
    combined_snr_db,
    francois_garrison_absorption_db_km,
    thorp_absorption_db_km,
    transmission_loss_db,
)
from zacoustic.channel.formulae.desert import (
    DESERT_SPREADING,
    DesertModulation,
    desert_packet_error_rate,
)
from zacoustic.channel.formulae.modulation import Modulation
from zacoustic.channel.formulae.noise import band_noise_level_db, flat_noise_level_db
from zacoustic.channel.profiles import ModemProfile
from zacoustic.channel.propagation.fading import Fading, fade_quantiles_db
from zacoustic.errors import ConfigError

SEA_FADING: Final = Fading(k_factor=3.0, shadowing_db=3.0, shadowing_time_s=30.0)
"""Fades of the channel ``sea``."""

_REFERENCE_WIND_M_S: Final = 5.0  # assumed sea state of published ranges
_REFERENCE_SHIPPING: Final = 0.5
_REFERENCE_FRAME_BYTES: Final = 64  # or the MTU, if smaller
_HALF_DB: Final = 10.0 * math.log10(2.0)
_WATER_DEPTH_M: Final = 50.0  # for the absorption, which changes by 1 % in 100 m
_SNR_SEARCH_DB: Final = (-80.0, 80.0)
_SNR_SEARCH_STEPS: Final = 30  # halvings of 160 dB: 1e-7 dB


class ChannelModel(ABC):
    """The channel between two nodes with one kind of modem.

    Attributes:
        noise_level_db: Ambient noise over the modem's band, dB re 1 µPa.
        fading: Fades that each frame meets, or None.
        detection_snr_db: Below this SNR a receiver notices nothing, dB.

    Args:
        profile: The modem.
        noise_level_db: See the attribute.
        absorption_db_km: Absorption at the centre of the band, dB/km.
        spreading: Spreading factor.
    """

    fading: Fading | None = None

    def __init__(
        self,
        profile: ModemProfile,
        *,
        noise_level_db: float,
        absorption_db_km: float,
        spreading: float,
    ) -> None:
        self.profile = profile
        self.noise_level_db = noise_level_db
        self.detection_snr_db = profile.detection_snr_db
        self._absorption_db_km = absorption_db_km
        self._spreading = spreading

    def received_level_db(self, distance_m: float) -> float:
        """Return the mean level at a distance in m, dB re 1 µPa."""
        return self.profile.source_level_db - transmission_loss_db(
            distance_m, self._absorption_db_km, spreading=self._spreading
        )

    def snr_db(self, distance_m: float) -> float:
        """Return the mean SNR over the band at a distance in m, dB."""
        return self.received_level_db(distance_m) - self.noise_level_db

    def effective_snr_db(self, distance_m: float) -> float:
        """Return the mean SNR that `frame_error_rate` expects, at a distance in m, dB."""
        return self.snr_db(distance_m)

    @abstractmethod
    def frame_error_rate(self, effective_snr_db: float, frame_bytes: int) -> float:
        """Return the probability, 0…1, that a frame of this effective SNR (dB, faded) is lost."""

    def mean_frame_error_rate(self, distance_m: float, frame_bytes: int) -> float:
        """Return the share of lost frames, 0…1, at a distance in m, over all fades."""
        mean_db = self.effective_snr_db(distance_m)
        if self.fading is None:
            return self.frame_error_rate(mean_db, frame_bytes)
        gains_db = fade_quantiles_db(self.fading)
        return sum(self.frame_error_rate(mean_db + gain, frame_bytes) for gain in gains_db) / len(
            gains_db
        )


class AwgnChannel(ChannelModel):
    """AWGN: only the sonar equation and the modulation."""

    def __init__(
        self,
        profile: ModemProfile,
        *,
        wind_m_s: float,
        shipping: float,
        spreading: float = PRACTICAL,
    ) -> None:
        super().__init__(
            profile,
            noise_level_db=band_noise_level_db(
                profile.frequency_hz, profile.bandwidth_hz, wind_m_s=wind_m_s, shipping=shipping
            ),
            absorption_db_km=francois_garrison_absorption_db_km(
                profile.frequency_hz, depth_m=_WATER_DEPTH_M
            ),
            spreading=spreading,
        )

    def frame_error_rate(self, effective_snr_db: float, frame_bytes: int) -> float:
        """Return the profile's value for this SNR."""
        return self.profile.frame_error_rate(effective_snr_db, frame_bytes)


class SilentChannel(AwgnChannel):
    """Geometry, half-duplex and collisions, without random loss."""

    def __init__(self, profile: ModemProfile, *, wind_m_s: float, shipping: float) -> None:
        super().__init__(profile, wind_m_s=wind_m_s, shipping=shipping)
        self.detection_snr_db = float("-inf")

    def frame_error_rate(self, effective_snr_db: float, frame_bytes: int) -> float:
        """Return 0."""
        return 0.0


class SeaChannel(AwgnChannel):
    """Direct path, noise, distortion and fades, scaled to the published range; see above."""

    fading: Fading | None = SEA_FADING

    def __init__(self, profile: ModemProfile, *, wind_m_s: float, shipping: float) -> None:
        super().__init__(profile, wind_m_s=wind_m_s, shipping=shipping, spreading=SPHERICAL)
        reference_noise_db = band_noise_level_db(
            profile.frequency_hz,
            profile.bandwidth_hz,
            wind_m_s=_REFERENCE_WIND_M_S,
            shipping=_REFERENCE_SHIPPING,
        )
        needed_db = _snr_of_half_the_frames_db(profile) + _HALF_DB
        self.implementation_loss_db = (
            self.received_level_db(profile.range_m) - reference_noise_db - needed_db
        )
        self._distortion_at_1m_db = needed_db + 10.0 * math.log10(profile.range_m)

    def effective_snr_db(self, distance_m: float) -> float:
        """Return the SNR after noise, implementation loss and distortion, dB."""
        noise_limited_db = self.snr_db(distance_m) - self.implementation_loss_db
        distortion_limited_db = self._distortion_at_1m_db - 10.0 * math.log10(max(distance_m, 1.0))
        return combined_snr_db(noise_limited_db, distortion_limited_db)


class RecordedChannel(SeaChannel):
    """The mean of `SeaChannel`; fades and distortion are those of a recording."""

    fading: Fading | None = None

    def effective_snr_db(self, distance_m: float) -> float:
        """Return the SNR after noise and implementation loss, dB."""
        return self.snr_db(distance_m) - self.implementation_loss_db


class DesertChannel(ChannelModel):
    """DESERT's formulae with BPSK and no penalty."""

    def __init__(self, profile: ModemProfile, *, wind_m_s: float, shipping: float) -> None:
        super().__init__(
            profile,
            noise_level_db=flat_noise_level_db(
                profile.frequency_hz, profile.bandwidth_hz, wind_m_s=wind_m_s, shipping=shipping
            ),
            absorption_db_km=thorp_absorption_db_km(profile.frequency_hz),
            spreading=DESERT_SPREADING,
        )

    def frame_error_rate(self, effective_snr_db: float, frame_bytes: int) -> float:
        """Return DESERT's packet error rate; 0 for the profile that loses nothing."""
        if self.profile.reception is Modulation.PERFECT:
            return 0.0
        return desert_packet_error_rate(DesertModulation.BPSK, effective_snr_db, 8 * frame_bytes)


def create_channel(
    name: str, profile: ModemProfile, *, wind_m_s: float, shipping: float
) -> ChannelModel:
    """Return a model by name for one kind of modem.

    Args:
        name: ``sea``, ``awgn``, ``none``, ``desert`` or ``recorded``.
        profile: The modem.
        wind_m_s: Wind speed, m/s, ≥ 0.
        shipping: Activity of ships, 0…1.

    Raises:
        ConfigError: No such model; the message lists the names.
    """
    match name:
        case "sea":
            return SeaChannel(profile, wind_m_s=wind_m_s, shipping=shipping)
        case "awgn":
            return AwgnChannel(profile, wind_m_s=wind_m_s, shipping=shipping)
        case "none":
            return SilentChannel(profile, wind_m_s=wind_m_s, shipping=shipping)
        case "desert":
            return DesertChannel(profile, wind_m_s=wind_m_s, shipping=shipping)
        case "recorded":
            return RecordedChannel(profile, wind_m_s=wind_m_s, shipping=shipping)
        case _:
            raise ConfigError(f"channel is {name!r}; allowed: awgn, desert, none, recorded, sea")


@functools.lru_cache(maxsize=64)
def _snr_of_half_the_frames_db(profile: ModemProfile) -> float:
    """Return the mean SNR at which `SEA_FADING` lets half of the frames through, dB."""
    frame_bytes = min(_REFERENCE_FRAME_BYTES, profile.mtu_bytes)
    gains_db = fade_quantiles_db(SEA_FADING)
    low_db, high_db = _SNR_SEARCH_DB
    for _ in range(_SNR_SEARCH_STEPS):
        middle_db = (low_db + high_db) / 2.0
        lost = sum(profile.frame_error_rate(middle_db + gain, frame_bytes) for gain in gains_db)
        if lost > 0.5 * len(gains_db):
            low_db = middle_db
        else:
            high_db = middle_db
    return (low_db + high_db) / 2.0
