"""The acknowledgement that a modem sends by itself: a short sound, a fixed time after the frame.

Since that time is fixed, the sender knows the propagation delay: half of the measured time less the
fixed one. The medium treats the acknowledgement like any frame, so it can be lost like any frame.
"""

from typing import Final

from zacoustic.channel.profiles import ModemProfile

ACKNOWLEDGEMENT_BYTES: Final = 1
"""Length of the sound, bytes of a frame: 0.16 s with an S2C, whose real one lasted 0.14 s."""
_MARGIN_NS: Final = 50_000_000


def turnaround_ns(profile: ModemProfile) -> int:
    """Return the time from the end of a frame to the acknowledgement, ns."""
    return round(profile.turnaround_s * 1e9)


def patience_ns(profile: ModemProfile, propagation_s: float) -> int:
    """Return how long after the end of its frame a modem waits for the acknowledgement, ns.

    Args:
        profile: The modem.
        propagation_s: Longest propagation delay, one way, s.
    """
    there_and_back_ns = round(2 * propagation_s * 1e9)
    sound_ns = profile.airtime_ns(ACKNOWLEDGEMENT_BYTES)
    return there_and_back_ns + turnaround_ns(profile) + sound_ns + _MARGIN_NS
