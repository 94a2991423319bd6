"""Ambient noise of the sea: Wenz's curves in the parametrisation of Coates and Stojanovic.

Four sources dominate one part of the spectrum each: turbulence (below 10 Hz), distant shipping
(10…200 Hz), wind and waves (0.2…100 kHz), thermal agitation (above). Modems use the third part, so
wind decides. The sum is a density, dB re 1 µPa²/Hz. A receiver sees the level over its band, either
flat (the density at the centre times the bandwidth, as in most simulators) or integrated. The flat
rule is optimistic, by 0.04 dB over 22.5–27.5 kHz and 0.4 dB over 18–34 kHz, because the spectrum
falls with frequency.

Source:
    R. Coates, "Underwater Acoustic Systems" (1990); M. Stojanovic, ACM WUWNet 2006; after G. M.
    Wenz, J. Acoust. Soc. Am. 34 (1962) 1936.
"""

import math
from typing import Final

from zacoustic.channel.formulae.acoustics import sum_of_levels_db

_INTEGRATION_STEPS: Final = 256  # even; Simpson's error over one octave is below 1e-9 dB


def turbulence_noise_db(frequency_hz: float) -> float:
    """Density of turbulence noise, dB re 1 µPa²/Hz; the frequency in Hz, > 0."""
    return 17.0 - 30.0 * math.log10(frequency_hz / 1000.0)


def shipping_noise_db(frequency_hz: float, shipping: float) -> float:
    """Density of the noise of distant ships, dB re 1 µPa²/Hz.

    Args:
        frequency_hz: Hz, > 0.
        shipping: Activity, 0 (none)…1 (heavy).
    """
    f = frequency_hz / 1000.0
    return 40.0 + 20.0 * (shipping - 0.5) + 26.0 * math.log10(f) - 60.0 * math.log10(f + 0.03)


def wind_noise_db(frequency_hz: float, wind_m_s: float) -> float:
    """Density of the noise of waves, dB re 1 µPa²/Hz.

    Args:
        frequency_hz: Hz, > 0.
        wind_m_s: Wind speed, m/s, ≥ 0.
    """
    f = frequency_hz / 1000.0
    return 50.0 + 7.5 * math.sqrt(wind_m_s) + 20.0 * math.log10(f) - 40.0 * math.log10(f + 0.4)


def thermal_noise_db(frequency_hz: float) -> float:
    """Density of thermal noise, dB re 1 µPa²/Hz; the frequency in Hz, > 0."""
    return -15.0 + 20.0 * math.log10(frequency_hz / 1000.0)


def ambient_noise_db(frequency_hz: float, *, wind_m_s: float = 0.0, shipping: float = 0.5) -> float:
    """Density of all ambient noise.

    Args:
        frequency_hz: Hz, > 0.
        wind_m_s: Wind speed, m/s, ≥ 0.
        shipping: Activity of distant ships, 0…1.

    Returns:
        Density, dB re 1 µPa²/Hz.

    Raises:
        ValueError: The frequency is not positive.
    """
    return sum_of_levels_db(
        turbulence_noise_db(frequency_hz),
        shipping_noise_db(frequency_hz, shipping),
        wind_noise_db(frequency_hz, wind_m_s),
        thermal_noise_db(frequency_hz),
    )


def flat_noise_level_db(
    frequency_hz: float, bandwidth_hz: float, *, wind_m_s: float = 0.0, shipping: float = 0.5
) -> float:
    """Noise over a band, assuming the density of its centre throughout.

    Args:
        frequency_hz: Centre of the band, Hz, > 0.
        bandwidth_hz: Hz, > 0.
        wind_m_s: Wind speed, m/s, ≥ 0.
        shipping: Activity of distant ships, 0…1.

    Returns:
        Level, dB re 1 µPa.
    """
    density_db = ambient_noise_db(frequency_hz, wind_m_s=wind_m_s, shipping=shipping)
    return density_db + 10.0 * math.log10(bandwidth_hz)


def band_noise_level_db(
    frequency_hz: float, bandwidth_hz: float, *, wind_m_s: float = 0.0, shipping: float = 0.5
) -> float:
    """Noise over a band, its density integrated by Simpson's rule.

    Args:
        frequency_hz: Centre of the band, Hz.
        bandwidth_hz: Hz, > 0 and below twice the centre.
        wind_m_s: Wind speed, m/s, ≥ 0.
        shipping: Activity of distant ships, 0…1.

    Returns:
        Level, dB re 1 µPa.

    Raises:
        ValueError: The band reaches down to 0 Hz or below.
    """
    low_hz = frequency_hz - bandwidth_hz / 2.0
    if not low_hz > 0.0:
        raise ValueError(f"the band starts at {low_hz} Hz; allowed: above 0")
    step_hz = bandwidth_hz / _INTEGRATION_STEPS
    total = 0.0
    for index in range(_INTEGRATION_STEPS + 1):
        weight = 1.0 if index in (0, _INTEGRATION_STEPS) else 4.0 if index % 2 else 2.0
        density_db = ambient_noise_db(
            low_hz + index * step_hz, wind_m_s=wind_m_s, shipping=shipping
        )
        total += weight * 10.0 ** (density_db / 10.0)
    return 10.0 * math.log10(total * step_hz / 3.0)
