"""Modem profiles: duration, level and error rate of frames.

There is one definition of frame time, `ModemProfile.airtime_s`, for the medium, the emulators, and
the capabilities that the simulated links report::

    airtime = preamble_s + frame_bytes · per_byte_s        the sound
    airtime + gap_s                                        until the sender takes the next frame

Figures come from data sheets, from published simulations (marked "sim") or from measurements;
`origin` names assumptions. With the given band, level and range, `sea` reproduces the published
range; they say nothing about a particular device.

`ideal` is not a real modem: 1 Gbit/s, no preamble, receives everything at once and loses nothing,
for tests in which only geometry causes delays.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import msgspec

from zacoustic.channel.formulae.acoustics import eb_n0_db
from zacoustic.channel.formulae.errorcurve import JANUS_BASELINE, MICROMODEM_RATE_1, FrameErrorCurve
from zacoustic.channel.formulae.modulation import (
    Modulation,
    bit_error_rate,
    packet_error_rate,
    ratio,
)
from zacoustic.errors import ConfigError

_NS_PER_S: Final = 1_000_000_000


class ModemProfile(msgspec.Struct, frozen=True, kw_only=True):
    """One kind of modem in one mode."""

    name: str
    """Key in `PROFILES`, as scenarios write it."""
    mtu_bytes: int
    """Largest frame, bytes, ≥ 1."""
    preamble_s: float
    """Airtime of an empty frame, s, ≥ 0."""
    per_byte_s: float
    """Airtime of each byte, coding included, s, > 0."""
    gap_s: float = 0.0
    """Pause of the sender after each frame, s, ≥ 0."""
    turnaround_s: float = 0.11
    """From the end of a frame to its acknowledgement, s, ≥ 0. Measured on an S2C, assumed for the
    others."""
    frequency_hz: float
    """Centre of the band, Hz, > 0."""
    bandwidth_hz: float
    """Width of the band, Hz, > 0."""
    source_level_db: float
    """Level over the band, dB re 1 µPa at 1 m."""
    range_m: float
    """Published range, m, > 0."""
    reception: Modulation | FrameErrorCurve
    """How SNR becomes frame errors: a modulation, or a measured curve."""
    half_duplex: bool = True
    """It cannot receive while it transmits."""
    detection_snr_db: float = -10.0
    """A receiver does not notice a frame below this SNR over the band, dB."""
    capture_db: float = 6.0
    """A frame this much stronger than its overlaps survives, dB. Measured (ahoi): 2.6 dB."""
    separates_senders: bool = False
    """Receives any number of frames at the same time; only `ideal`."""
    origin: str
    """Source of the figures, and which of them are assumed."""

    @property
    def bit_rate_bps(self) -> float:
        """Marginal bit rate: eight more bits take 8 / bit_rate_bps seconds longer."""
        return 8.0 / self.per_byte_s

    def airtime_s(self, frame_bytes: int) -> float:
        """Return the airtime of a frame of some bytes, s, without the gap."""
        return self.preamble_s + frame_bytes * self.per_byte_s

    def airtime_ns(self, frame_bytes: int) -> int:
        """Return `airtime_s` as integer ns, to the nearest."""
        return round(self.airtime_s(frame_bytes) * _NS_PER_S)

    @property
    def gap_ns(self) -> int:
        """`gap_s` as integer ns, to the nearest."""
        return round(self.gap_s * _NS_PER_S)

    def frame_error_rate(self, snr_db: float, frame_bytes: int) -> float:
        """Return the probability that noise destroys a frame of constant SNR.

        Args:
            snr_db: SNR over the band, dB, implementation losses already subtracted.
            frame_bytes: Length of the frame, bytes.

        Returns:
            Probability, 0…1.
        """
        if isinstance(self.reception, FrameErrorCurve):
            return self.reception.frame_error_rate(snr_db, frame_bytes)
        per_bit_db = eb_n0_db(
            snr_db, bandwidth_hz=self.bandwidth_hz, bit_rate_bps=self.bit_rate_bps
        )
        return packet_error_rate(bit_error_rate(self.reception, ratio(per_bit_db)), 8 * frame_bytes)

    def notices(self, snr_db: float) -> bool:
        """Tell whether a receiver notices the beginning of a frame; `ideal` reports no carrier."""
        return not self.separates_senders and snr_db >= self.detection_snr_db

    def overlaps_band_of(self, other: "ModemProfile") -> bool:
        """Whether this modem hears the other one's sound, at least as noise."""
        return abs(self.frequency_hz - other.frequency_hz) < (
            (self.bandwidth_hz + other.bandwidth_hz) / 2.0
        )


def profile_named(name: str) -> ModemProfile:
    """Return a profile by name.

    Raises:
        ConfigError: No such profile; the message lists the names.
    """
    try:
        return PROFILES[name]
    except KeyError:
        raise ConfigError(f"profile is {name!r}; allowed: {', '.join(sorted(PROFILES))}") from None


_ALL = (
    ModemProfile(
        name="evologics_s2c_18_34",
        mtu_bytes=64,
        # Straight line through the published airtimes of 1…64 bytes, 14 ms off at most; 64 bytes:
        # 0.860 s.
        preamble_s=0.1503,
        per_byte_s=0.011094,
        # Measured pause between instant messages, 88…93 ms: 64 bytes every 0.951 s are 539 bit/s.
        gap_s=0.0904,
        frequency_hz=26_000.0,
        bandwidth_hz=16_000.0,
        source_level_db=184.0,
        range_m=3500.0,
        reception=Modulation.DBPSK,
        origin="EvoLogics S2CR 18/34, instant messages: airtimes and 184 dB of DESERT's sample, "
        "range of the data sheet; the modulation stands in for the sweep-spread carrier",
    ),
    ModemProfile(
        name="evologics_s2c_7_17",
        mtu_bytes=64,
        preamble_s=0.1503,
        per_byte_s=8.0 / 2400.0,
        gap_s=0.0904,
        frequency_hz=12_000.0,
        bandwidth_hz=5_000.0,
        source_level_db=187.8,
        range_m=8000.0,
        reception=Modulation.DBPSK,
        origin="EvoLogics S2CR 7/17: band, 2400 bit/s, level and range of DESERT's sample (sim); "
        "MTU, preamble and gap assumed as in the 18/34",
    ),
    ModemProfile(
        name="whoi_micromodem_fsk",
        mtu_bytes=32,
        preamble_s=0.3,
        per_byte_s=8.0 / 80.0,
        frequency_hz=25_000.0,
        bandwidth_hz=4_000.0,
        source_level_db=185.0,
        range_m=4000.0,
        reception=Modulation.NCFSK,
        origin="WHOI Micromodem, FSK at 80 bit/s, one frame of 32 bytes, band and level as "
        "published; probe assumed as in PSK rate 6, range assumed",
    ),
    ModemProfile(
        name="whoi_micromodem_psk6",
        mtu_bytes=192,
        # Six frames of 32 bytes in 2.95 s, behind a probe of 0.30 s.
        preamble_s=0.30,
        per_byte_s=2.95 / 192.0,
        frequency_hz=25_000.0,
        bandwidth_hz=5_000.0,
        source_level_db=185.0,
        range_m=3000.0,
        reception=MICROMODEM_RATE_1,
        origin="WHOI Micromodem, PSK rate 6: timing, band and level as published; error curve of "
        "rate 1, which also carries 192 bytes; range assumed",
    ),
    ModemProfile(
        name="waterlinked_m64",
        mtu_bytes=8,
        # 8 bytes take 0.5 s, then it is the other modem's turn: one packet a second, 64 bit/s in
        # each direction.
        preamble_s=0.0,
        per_byte_s=0.0625,
        gap_s=0.5,
        frequency_hz=109_375.0,
        bandwidth_hz=31_250.0,
        source_level_db=160.0,
        range_m=200.0,
        reception=Modulation.DBPSK,
        origin="Water Linked M64: packet, rate, latency, range as published; the third of "
        "seven bands; level and modulation assumed",
    ),
    ModemProfile(
        name="ahoi",
        mtu_bytes=64,
        preamble_s=0.0,
        per_byte_s=8.0 / 260.0,
        frequency_hz=62_500.0,
        bandwidth_hz=25_000.0,
        source_level_db=156.0,
        range_m=150.0,
        reception=Modulation.NCFSK,
        capture_db=2.6,
        origin="ahoi (Renner et al., ACM TOSN 2020): band, 260 bit/s, range; level (sim) and "
        "capture of DESERT's sample; MTU and modulation assumed, preamble unknown",
    ),
    ModemProfile(
        name="janus",
        mtu_bytes=480,
        # Baseline packet 1.1 s, cargo of N bytes 0.1 (N + 1) s.
        preamble_s=1.2,
        per_byte_s=0.1,
        frequency_hz=11_520.0,
        bandwidth_hz=4_160.0,
        source_level_db=185.0,
        range_m=5000.0,
        reception=JANUS_BASELINE,
        detection_snr_db=-15.0,
        origin="JANUS parameter set 1 with cargo; level and range assumed",
    ),
    ModemProfile(
        name="nanomodem",
        mtu_bytes=64,
        # 640 bit/s, of which 463 remain with frames of 64 bytes.
        preamble_s=512.0 / 463.0 - 512.0 / 640.0,
        per_byte_s=8.0 / 640.0,
        frequency_hz=28_000.0,
        bandwidth_hz=8_000.0,
        source_level_db=168.0,
        range_m=2000.0,
        reception=Modulation.DBPSK,
        origin="Nanomodem v3 (Newcastle, USMART): band, rates, level, range as published; "
        "modulation assumed",
    ),
    ModemProfile(
        name="ideal",
        mtu_bytes=512,
        preamble_s=0.0,
        per_byte_s=8.0e-9,
        turnaround_s=0.0,
        frequency_hz=26_000.0,
        bandwidth_hz=16_000.0,
        source_level_db=184.0,
        range_m=1.0e6,
        reception=Modulation.PERFECT,
        half_duplex=False,
        detection_snr_db=float("-inf"),
        separates_senders=True,
        origin="no modem: 1 Gbit/s without noise, collisions or turn-around",
    ),
)

PROFILES: Final[Mapping[str, ModemProfile]] = MappingProxyType(
    {profile.name: profile for profile in _ALL}
)
"""Name → profile."""

DEFAULT_PROFILE: Final = "evologics_s2c_18_34"
"""Profile of scenarios that name none."""
