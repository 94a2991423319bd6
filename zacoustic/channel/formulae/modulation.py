"""From SNR to lost frames: error rates of the modems' modulations, with AWGN and with fading.

γ is Eb/N0 as a ratio. For AWGN the closed forms are textbook ones. With fading two averages exist,
which simulators often confuse:

- *per bit*: each bit meets its own gain. The bit error rate is averaged over the fading, and a
  frame of 1000 bits practically never survives Rayleigh fading at 15 dB.
- *block*: one gain holds for the whole frame, because the channel changes more slowly than a frame
  lasts. The *frame* error rate is averaged, and the same frame survives in 85 of 100 cases.

Frames of acoustic modems last 0.1…3 s and the channel's coherence time at these carriers is of that
order, so `sea` uses the block form (drawn per frame, `fading`); the averages here are for planning
and for checking the draws.

Source:
    J. G. Proakis, "Digital Communications", ch. 4 and 13; M. K. Simon, M.-S. Alouini, "Digital
    Communication over Fading Channels" (the moment-generating-function form used for Rician BPSK).
"""

import enum
import math
from collections.abc import Callable
from typing import Final, assert_never

_ANGLES: Final = 512  # trapezoids of a smooth periodic integrand: converges faster than any power
_BLOCK_STEPS: Final = 4000  # Simpson steps over the fade: five digits of the frame error rate


class Modulation(enum.Enum):
    """Modulation of a modem."""

    BPSK = "bpsk"
    """Coherent binary phase shift keying."""
    DBPSK = "dbpsk"
    """Differential binary phase shift keying: no carrier recovery."""
    BFSK = "bfsk"
    """Binary frequency shift keying, detected coherently."""
    NCFSK = "ncfsk"
    """Binary frequency shift keying, detected by energy."""
    PERFECT = "perfect"
    """Loses nothing at any SNR; only for the profile `ideal`."""


def bit_error_rate(modulation: Modulation, gamma: float) -> float:
    """Bit error rate with AWGN.

    Args:
        modulation: One of the enumeration.
        gamma: Eb/N0 as a ratio (not dB), ≥ 0.

    Returns:
        Probability, 0…0.5.
    """
    match modulation:
        case Modulation.BPSK:
            return 0.5 * math.erfc(math.sqrt(gamma))
        case Modulation.DBPSK:
            return 0.5 * math.exp(-gamma)
        case Modulation.BFSK:
            return 0.5 * math.erfc(math.sqrt(gamma / 2.0))
        case Modulation.NCFSK:
            return 0.5 * math.exp(-gamma / 2.0)
        case Modulation.PERFECT:
            return 0.0
        case _:
            assert_never(modulation)


def rayleigh_bit_error_rate(modulation: Modulation, gamma: float) -> float:
    """Bit error rate when each bit meets its own Rayleigh fade.

    Args:
        modulation: One of the enumeration.
        gamma: Mean Eb/N0 as a ratio, ≥ 0.

    Returns:
        Probability, 0…0.5.
    """
    match modulation:
        case Modulation.BPSK:
            return 0.5 * (1.0 - math.sqrt(gamma / (1.0 + gamma)))
        case Modulation.DBPSK:
            return 0.5 / (1.0 + gamma)
        case Modulation.BFSK:
            return 0.5 * (1.0 - math.sqrt(gamma / (2.0 + gamma)))
        case Modulation.NCFSK:
            return 1.0 / (2.0 + gamma)
        case Modulation.PERFECT:
            return 0.0
        case _:
            assert_never(modulation)


def rician_ncfsk_bit_error_rate(gamma: float, k_factor: float) -> float:
    """Bit error rate of non-coherent BFSK when each bit meets its own Rician fade; closed form.

    Args:
        gamma: Mean Eb/N0 as a ratio, ≥ 0.
        k_factor: Power of the steady path over that of the scattered ones, a ratio, ≥ 0; 0 is
            Rayleigh.

    Returns:
        Probability, 0…0.5.
    """
    scale = 2.0 + 2.0 * k_factor + gamma
    return (1.0 + k_factor) / scale * math.exp(-k_factor * gamma / scale)


def rician_bpsk_bit_error_rate(gamma: float, k_factor: float) -> float:
    """Bit error rate of BPSK when each bit meets its own Rician fade; numerically, to ten digits.

    The Gaussian tail is written as an integral over an angle, so that averaging over the fade turns
    it into the fade's moment-generating function.

    Args:
        gamma: Mean Eb/N0 as a ratio, ≥ 0.
        k_factor: Power of the steady path over that of the scattered ones, a ratio, ≥ 0.

    Returns:
        Probability, 0…0.5.
    """
    total = 0.0
    for index in range(_ANGLES):
        sine = math.sin((index + 0.5) * math.pi / 2.0 / _ANGLES)
        scaled = gamma / (sine * sine)
        bottom = 1.0 + k_factor + scaled
        total += (1.0 + k_factor) / bottom * math.exp(-k_factor * scaled / bottom)
    return total / (2.0 * _ANGLES)


def mfsk_symbol_error_rate(order: int, gamma_symbol: float) -> float:
    """Symbol error rate of non-coherent M-FSK with AWGN.

    Args:
        order: Number of tones M, 2…64.
        gamma_symbol: Es/N0 as a ratio, ≥ 0.

    Returns:
        Probability, 0…1.
    """
    return sum(
        (-1.0) ** (n + 1)
        * math.comb(order - 1, n)
        / (n + 1)
        * math.exp(-n * gamma_symbol / (n + 1))
        for n in range(1, order)
    )


def mfsk_bit_error_rate(order: int, gamma_symbol: float) -> float:
    """Bit error rate of non-coherent M-FSK: about half of the bits of a wrong symbol are wrong."""
    return order / 2.0 / (order - 1) * mfsk_symbol_error_rate(order, gamma_symbol)


def packet_error_rate(ber: float, bits: int) -> float:
    """Probability that at least one of some independent bits is wrong.

    Args:
        ber: Bit error rate, 0…1; accurate also far below 1e-16.
        bits: Bits of the frame, ≥ 0.

    Returns:
        Probability, 0…1.
    """
    if ber >= 1.0:
        return 1.0 if bits else 0.0
    return -math.expm1(bits * math.log1p(-ber))


def block_rayleigh_packet_error_rate(modulation: Modulation, gamma: float, bits: int) -> float:
    """Frame error rate when one Rayleigh fade holds for the whole frame.

    Args:
        modulation: One of the enumeration.
        gamma: Mean Eb/N0 as a ratio, > 0.
        bits: Bits of the frame, ≥ 1.

    Returns:
        Probability, 0…1, to about five digits.
    """

    def error_density(instantaneous: float) -> float:
        per = packet_error_rate(bit_error_rate(modulation, instantaneous), bits)
        return per * math.exp(-instantaneous / gamma) / gamma

    # Above this Eb/N0 no modulation here leaves an error in a frame that fits a modem.
    ceiling = 2.0 * (math.log(max(bits, 1)) + 23.0)
    return _simpson(error_density, ceiling)


def ratio(level_db: float) -> float:
    """Power ratio of a level in dB."""
    return math.pow(10.0, level_db / 10.0)


def _simpson(density: Callable[[float], float], ceiling: float) -> float:
    step = ceiling / _BLOCK_STEPS
    odd = sum(density((2 * i + 1) * step) for i in range(_BLOCK_STEPS // 2))
    even = sum(density(2 * i * step) for i in range(1, _BLOCK_STEPS // 2))
    return (density(0.0) + density(ceiling) + 4.0 * odd + 2.0 * even) * step / 3.0
