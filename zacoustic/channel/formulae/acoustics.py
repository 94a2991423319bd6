"""Sound in the sea, as pure functions: absorption, spreading, the sonar equation, delay.

The passive terms of one link, in the order of their addition::

    received level  RL  = SL − TL(d, f)                           dB re 1 µPa
    noise level     NL  = 10 log10 ∫ N(f) df  ≈  N(fc) + 10 log10 B   dB re 1 µPa
    SNR             = RL − NL + DI                                dB, over the bandwidth B
    Eb/N0           = SNR + 10 log10(B / bit rate) − IL           dB

SL is the source level at 1 m, TL the transmission loss, DI the directivity index of the receiver,
IL the implementation loss of a real receiver. All levels are re 1 µPa (source levels at 1 m),
spectra re 1 µPa²/Hz. The formulae take their traditional units (kHz, km) only inside; arguments are
Hz and m.

Sound speed is in `soundspeed`; error rates as functions of an SNR are in `modulation`.
"""

import math
from typing import Final

DEFAULT_SOUND_SPEED_M_S: Final = 1500.0
"""Round figure of many simulators, DESERT included; real water has 1400…1560 m/s."""

CYLINDRICAL: Final = 1.0
"""Spreading factor of sound trapped between surface and bottom."""
PRACTICAL: Final = 1.5
"""Spreading factor between the two laws, for unknown conditions."""
SPHERICAL: Final = 2.0
"""Spreading factor of the direct path, away from every boundary."""

_LEVEL_OF_ONE_WATT_DB: Final = 170.8  # 1 W omnidirectional in sea water, dB re 1 µPa at 1 m


def thorp_absorption_db_km(frequency_hz: float) -> float:
    """Absorption of sound in sea water, Thorp's formula with its low-frequency branch.

    Args:
        frequency_hz: Acoustic frequency, Hz, > 0. Commonly used up to about 50 kHz.

    Returns:
        Absorption, dB/km, never negative.

    Raises:
        ValueError: The frequency is not positive.

    Source:
        W. H. Thorp, J. Acoust. Soc. Am. 42 (1967) 270, in the metric form of Stojanovic.
    """
    square = _kilohertz(frequency_hz) ** 2
    relaxation = 0.11 * square / (1.0 + square)
    if frequency_hz < 400.0:
        return 0.002 + relaxation + 0.011 * square
    return relaxation + 44.0 * square / (4100.0 + square) + 2.75e-4 * square + 0.003


def ainslie_mccolm_absorption_db_km(
    frequency_hz: float,
    *,
    temperature_c: float = 10.0,
    salinity_psu: float = 35.0,
    depth_m: float = 0.0,
    ph: float = 8.0,
) -> float:
    """Absorption of sound in sea water, Ainslie and McColm's simplification.

    Args:
        frequency_hz: Acoustic frequency, Hz, > 0; stated for 100 Hz…1 MHz.
        temperature_c: −6…35 °C.
        salinity_psu: 5…50.
        depth_m: 0…7000 m.
        ph: 7.7…8.3.

    Returns:
        Absorption, dB/km.

    Raises:
        ValueError: The frequency is not positive.

    Source:
        M. A. Ainslie, J. G. McColm, J. Acoust. Soc. Am. 103 (1998) 1671.
    """
    square = _kilohertz(frequency_hz) ** 2
    depth_km = depth_m / 1000.0
    boron = 0.78 * math.sqrt(salinity_psu / 35.0) * math.exp(temperature_c / 26.0)
    magnesium = 42.0 * math.exp(temperature_c / 17.0)
    return (
        0.106 * boron * square / (boron**2 + square) * math.exp((ph - 8.0) / 0.56)
        + 0.52
        * (1.0 + temperature_c / 43.0)
        * (salinity_psu / 35.0)
        * magnesium
        * square
        / (magnesium**2 + square)
        * math.exp(-depth_km / 6.0)
        + 0.00049 * square * math.exp(-(temperature_c / 27.0 + depth_km / 17.0))
    )


def francois_garrison_absorption_db_km(
    frequency_hz: float,
    *,
    temperature_c: float = 10.0,
    salinity_psu: float = 35.0,
    depth_m: float = 0.0,
    ph: float = 8.0,
) -> float:
    """Absorption of sound in sea water, Francois and Garrison.

    Args:
        frequency_hz: Acoustic frequency, Hz, > 0; stated for 200 Hz…1 MHz.
        temperature_c: −2…30 °C.
        salinity_psu: 30…35, usable from 0.
        depth_m: 0…5000 m.
        ph: 7.7…8.3.

    Returns:
        Absorption, dB/km.

    Raises:
        ValueError: The frequency is not positive.

    Source:
        R. E. Francois, G. R. Garrison, J. Acoust. Soc. Am. 72 (1982) 1879.
    """
    square = _kilohertz(frequency_hz) ** 2
    t, s, d = temperature_c, salinity_psu, depth_m
    kelvin = t + 273.0
    speed = 1412.0 + 3.21 * t + 1.19 * s + 0.0167 * d

    boron_gain = 8.86 / speed * math.pow(10.0, 0.78 * ph - 5.0)
    boron = 2.8 * math.sqrt(s / 35.0) * math.pow(10.0, 4.0 - 1245.0 / kelvin)

    magnesium_gain = 21.44 * s / speed * (1.0 + 0.025 * t)
    magnesium = 8.17 * math.pow(10.0, 8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (s - 35.0))
    magnesium_pressure = 1.0 - 1.37e-4 * d + 6.2e-9 * d**2

    if t <= 20.0:
        water_gain = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.5e-8 * t**3
    else:
        water_gain = 3.964e-4 - 1.146e-5 * t + 1.45e-7 * t**2 - 6.5e-10 * t**3
    water_pressure = 1.0 - 3.83e-5 * d + 4.9e-10 * d**2

    return (
        boron_gain * boron * square / (boron**2 + square)
        + magnesium_gain * magnesium_pressure * magnesium * square / (magnesium**2 + square)
        + water_gain * water_pressure * square
    )


def transmission_loss_db(
    distance_m: float, absorption_db_km: float, *, spreading: float = PRACTICAL
) -> float:
    """Loss between 1 m from the source and the receiver: spreading and absorption.

    Args:
        distance_m: Slant distance, m; up to 1 m the loss is 0, so that co-located nodes are
            allowed.
        absorption_db_km: From one of the absorption formulae, dB/km, ≥ 0.
        spreading: 1 cylindrical, 1.5 practical, 2 spherical; DESERT takes 1.75.

    Returns:
        Loss, dB, ≥ 0.
    """
    if distance_m <= 1.0:
        return 0.0
    return spreading * 10.0 * math.log10(distance_m) + absorption_db_km * distance_m / 1000.0


def received_level_db(source_level_db: float, loss_db: float) -> float:
    """Level at the receiver, dB re 1 µPa: source level (dB re 1 µPa at 1 m) less loss (dB)."""
    return source_level_db - loss_db


def snr_db(level_db: float, noise_level_db: float, *, directivity_db: float = 0.0) -> float:
    """Signal-to-noise ratio over the receiver's band, the sonar equation.

    Args:
        level_db: Received level, dB re 1 µPa.
        noise_level_db: Noise over the same band, dB re 1 µPa.
        directivity_db: Directivity index of the receiver, dB, ≥ 0.

    Returns:
        SNR, dB.
    """
    return level_db - noise_level_db + directivity_db


def eb_n0_db(
    snr: float, *, bandwidth_hz: float, bit_rate_bps: float, implementation_loss_db: float = 0.0
) -> float:
    """Energy per bit over noise density, dB, from the SNR (dB) over the bandwidth.

    Args:
        snr: SNR over the whole bandwidth, dB.
        bandwidth_hz: That bandwidth, Hz, > 0.
        bit_rate_bps: Bit rate of the modem, bit/s, > 0.
        implementation_loss_db: What a real receiver loses against the theoretical one, dB, ≥ 0.

    Returns:
        Eb/N0, dB.
    """
    return snr + 10.0 * math.log10(bandwidth_hz / bit_rate_bps) - implementation_loss_db


def source_level_of_power_db(acoustic_power_w: float, *, directivity_db: float = 0.0) -> float:
    """Source level of an acoustic power.

    Args:
        acoustic_power_w: Acoustic, not electrical, power, W, > 0.
        directivity_db: Transmit directivity index, dB; 0 is omnidirectional.

    Returns:
        Source level, dB re 1 µPa at 1 m.
    """
    return _LEVEL_OF_ONE_WATT_DB + 10.0 * math.log10(acoustic_power_w) + directivity_db


def sum_of_levels_db(*levels_db: float) -> float:
    """Incoherent sum of levels that share one reference, dB; any level may be as low as −∞."""
    loudest = max(levels_db)
    if loudest == float("-inf"):
        return loudest
    return loudest + 10.0 * math.log10(
        sum(math.pow(10.0, (level - loudest) / 10.0) for level in levels_db)
    )


def combined_snr_db(*snrs_db: float) -> float:
    """SNR that results when the noises of several SNRs add up, dB."""
    return -sum_of_levels_db(*(-snr for snr in snrs_db))


def propagation_delay_s(
    distance_m: float, *, sound_speed_m_s: float = DEFAULT_SOUND_SPEED_M_S
) -> float:
    """One-way travel time between two fixed places, s.

    Args:
        distance_m: Slant distance, m, ≥ 0.
        sound_speed_m_s: Speed of sound, m/s, > 0.
    """
    return distance_m / sound_speed_m_s


def doppler_factor(
    closing_speed_m_s: float, *, sound_speed_m_s: float = DEFAULT_SOUND_SPEED_M_S
) -> float:
    """Relative shift of frequencies, v/c: positive when the nodes approach each other.

    A carrier arrives at f (1 + factor), a frame lasts airtime / (1 + factor).
    """
    return closing_speed_m_s / sound_speed_m_s


def _kilohertz(frequency_hz: float) -> float:
    if not frequency_hz > 0.0:
        raise ValueError(f"frequency is {frequency_hz} Hz; allowed: above 0")
    return frequency_hz / 1000.0
