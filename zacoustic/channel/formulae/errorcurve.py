"""Measured frame error rates: a few (SNR, rate) points with straight lines between them.

For a modem whose coding has no closed formula, the measured curve is the model. A curve holds for
frames of one length; other lengths follow from independent errors along the frame: ``1 − (1 −
FER)^(n / n₀)``.
"""

import math
from bisect import bisect_right
from typing import Final

import msgspec


class FrameErrorCurve(msgspec.Struct, frozen=True, kw_only=True):
    """Frame error rate over SNR, for frames of one length."""

    reference_bytes: int
    """Length of the frames that the points were measured with, bytes, ≥ 1."""
    points: tuple[tuple[float, float], ...]
    """(SNR over the modem's band in dB, frame error rate 0…1), SNR rising, at least two."""

    def frame_error_rate(self, snr_db: float, frame_bytes: int) -> float:
        """Return the frame error rate, 0…1, at this SNR (dB); constant beyond the ends."""
        rate = self._reference_rate(snr_db)
        if rate in (0.0, 1.0) or frame_bytes == self.reference_bytes:
            return rate
        return 1.0 - math.pow(1.0 - rate, frame_bytes / self.reference_bytes)

    def _reference_rate(self, snr_db: float) -> float:
        index = bisect_right(self.points, (snr_db, 2.0))
        if index == 0:
            return self.points[0][1]
        if index == len(self.points):
            return self.points[-1][1]
        (low_db, low), (high_db, high) = self.points[index - 1], self.points[index]
        return low + (high - low) * (snr_db - low_db) / (high_db - low_db)


MICROMODEM_RATE_1: Final = FrameErrorCurve(
    reference_bytes=64,
    points=(
        (-7.957, 1.0),
        (-7.604, 0.9367),
        (-7.234, 0.7267),
        (-6.845, 0.17),
        (-6.444, 0.02),
        (-6.012, 0.0),
    ),
)
"""WHOI Micromodem, PSK rate 1 (frames of 64 bytes). Source: tables of WHOI's ros_acomms."""

MICROMODEM_RATE_3: Final = FrameErrorCurve(
    reference_bytes=256,
    points=(
        (-2.9215, 1.0),
        (-2.2806, 0.91),
        (-1.5853, 0.57),
        (-0.8275, 0.115),
        (0.0044, 0.025),
    ),
)
"""WHOI Micromodem, PSK rate 3 (frames of 256 bytes). Source: tables of WHOI's ros_acomms."""

MICROMODEM_RATE_5: Final = FrameErrorCurve(
    reference_bytes=256,
    points=((3.097, 1.0), (4.443, 0.135), (6.015, 0.0)),
)
"""WHOI Micromodem, PSK rate 5 (frames of 256 bytes). Source: tables of WHOI's ros_acomms."""

_JANUS_SNR_OF_CHIP_DB: Final = -14.15  # SNR over 4160 Hz less Ec/N0: 160 chips/s of 6.25 ms

JANUS_BASELINE: Final = FrameErrorCurve(
    reference_bytes=8,
    points=tuple(
        (ec_n0_db + _JANUS_SNR_OF_CHIP_DB, rate)
        for ec_n0_db, rate in (
            (2.0, 1.0),
            (3.0, 0.8075),
            (3.5, 0.5703),
            (4.0, 0.3070),
            (4.5, 0.1135),
            (5.0, 0.0307),
            (5.5, 0.0063),
            (6.0, 0.0008),
            (7.0, 0.0),
        )
    ),
)
"""JANUS baseline packet (64 bits), soft decoding, AWGN; 4000 simulated packets a point.

The two ends are extrapolated.
"""
