"""DESERT's own channel, apart from ours, to reproduce its numbers and compare them.

It uses Thorp's absorption, spreading 1.75, flat noise and a constant sound speed of 1500 m/s. Its
main peculiarity: it takes the SNR over the bandwidth for Eb/N0, without regard to the bit rate,
after a "penalty" (−10 dB by default, 0 in every sample that it ships). Interference enters as mean
power; a receiver locks on the first frame above a threshold.

Source:
    DESERT Underwater, ``physical/uwphysical`` and the NSMIRACLE ``Underwater`` propagation classes;
    formulae only.
"""

import enum
import math
from typing import Final, assert_never

from zacoustic.channel.formulae.acoustics import (
    snr_db,
    thorp_absorption_db_km,
    transmission_loss_db,
)
from zacoustic.channel.formulae.modulation import packet_error_rate, ratio
from zacoustic.channel.formulae.noise import flat_noise_level_db
from zacoustic.channel.formulae.soundspeed import coppens_sound_speed_m_s

DESERT_SPREADING: Final = 1.75
"""Default spreading factor of DESERT."""


class DesertModulation(enum.Enum):
    """Modulations by their names in DESERT."""

    BPSK = "BPSK"
    """Coherent."""
    BFSK = "BFSK"
    """Detected by energy."""
    PSK8 = "8PSK"
    """Eight phases."""
    PSK16 = "16PSK"
    """Sixteen phases."""
    PSK32 = "32PSK"
    """Thirty-two phases."""


_PHASES: Final = {
    DesertModulation.PSK8: 8,
    DesertModulation.PSK16: 16,
    DesertModulation.PSK32: 32,
}


def desert_snr_db(
    distance_m: float,
    *,
    source_level_db: float,
    frequency_hz: float,
    bandwidth_hz: float,
    spreading: float = DESERT_SPREADING,
    wind_m_s: float = 0.0,
    shipping: float = 0.5,
) -> float:
    """SNR over the bandwidth as DESERT computes it, with its defaults.

    Args:
        distance_m: Slant distance, m.
        source_level_db: dB re 1 µPa at 1 m.
        frequency_hz: Centre of the band, Hz.
        bandwidth_hz: Hz.
        spreading: Spreading factor.
        wind_m_s: Wind speed, m/s.
        shipping: Activity of ships, 0…1.

    Returns:
        SNR, dB.
    """
    loss_db = transmission_loss_db(
        distance_m, thorp_absorption_db_km(frequency_hz), spreading=spreading
    )
    noise_db = flat_noise_level_db(frequency_hz, bandwidth_hz, wind_m_s=wind_m_s, shipping=shipping)
    return snr_db(source_level_db - loss_db, noise_db)


def desert_bit_error_rate(modulation: DesertModulation, snr: float) -> float:
    """Bit error rate at an SNR in dB, taken for Eb/N0."""
    gamma = ratio(snr)
    match modulation:
        case DesertModulation.BPSK:
            return 0.5 * math.erfc(math.sqrt(gamma))
        case DesertModulation.BFSK:
            return 0.5 * math.exp(-gamma / 2.0)
        case DesertModulation.PSK8 | DesertModulation.PSK16 | DesertModulation.PSK32:
            phases = _PHASES[modulation]
            bits = math.log2(phases)
            return math.erfc(math.sqrt(gamma * bits) * math.sin(math.pi / phases)) / bits
        case _:
            assert_never(modulation)


def desert_packet_error_rate(
    modulation: DesertModulation, snr: float, bits: int, *, penalty_db: float = 0.0
) -> float:
    """Packet error rate at an SNR (or SINR).

    Args:
        modulation: One of the enumeration.
        snr: SNR over the bandwidth, dB.
        bits: Bits of the packet, ≥ 1.
        penalty_db: Added to the SNR, dB; DESERT's default is −10, its samples set 0.

    Returns:
        Probability, 0…1.
    """
    return packet_error_rate(desert_bit_error_rate(modulation, snr + penalty_db), bits)


def desert_depth_sound_speed_m_s(
    temperature_c: float, depth_m: float, *, salinity_psu: float = 35.0
) -> float:
    """Sound speed of DESERT's propagation module: Coppens at the surface, a shorter depth term.

    Args:
        temperature_c: °C.
        depth_m: m.
        salinity_psu: Always 35 in DESERT.

    Returns:
        Sound speed, m/s.
    """
    depth_km = depth_m / 1000.0
    surface = coppens_sound_speed_m_s(temperature_c, salinity_psu, 0.0)
    return surface + 16.3 * depth_km + 0.18 * depth_km**2
