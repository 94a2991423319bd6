"""Trains of burst data: how long they should be, and when the receiver of one can hear again.

The modem sends packets in trains, each acknowledged as a whole, and repeats one that is not. Who
has something to say to this node, or to the one that receives the data, waits for the end of a
train: so trains are kept to `TRAIN_LIMIT_S` by the number of packets in them (`AT!ZC`). A lost one
costs its own time and that of the answer that does not come, several seconds. So the more of them
are lost, the longer they may be, up to `LONGEST_TRAIN_S`; else the waiting would take most of the
time.

A train has no name in any source. It is taken to be a sound to the receiver of the data that is
longer than any message.
"""

from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic_evologics.at.fields import BURST_LIMIT_BYTES
from zacoustic_evologics.at.notifications import SendStart

TRAIN_LIMIT_S: Final = 4.1
"""The longest train of packets while none are lost, s; each has at least one packet."""
LONGEST_TRAIN_S: Final = 8.0
"""The longest train whatever is lost, s."""
_LONGER_S: Final = 12.0
"""How much longer trains would be if all were lost, s."""
_MOST_PACKETS: Final = 10
"""The most packets in a train: more are for modems that do not move."""
_LEAST_US: Final = 1_000_000
"""A sound of this length is no message: 64 bytes last 0.86 s. No shorter train is too long."""
_LONGEST_US: Final = 15_000_000
"""Nothing sounds longer: a damaged number must not keep urgent messages back."""
_LATELY: Final = 0.125
"""The part of the last train in the share of lost ones."""
_ACKNOWLEDGING_S: Final = 0.8
"""After the end of a train its receiver turns round and acknowledges, s: 0.25, and up to half a
second more with a piggyback message."""


class Trains:
    """The trains of one modem."""

    def __init__(self) -> None:
        self.sounds_until = 0
        """When the modem's last sound ends, ns."""
        self._bit_rate_bps = 0
        self._lost_share = 0.0
        self._is_unanswered = False

    @property
    def is_answered_at(self) -> int:
        """When the receiver of a train that sounds now, or did last, has acknowledged it, ns."""
        return self.sounds_until + seconds_to_ns(_ACKNOWLEDGING_S)

    @property
    def packets(self) -> int | None:
        """The most packets that a train should have; None: the bit rate is not known yet."""
        if not self._bit_rate_bps:
            return None
        limit_s = min(LONGEST_TRAIN_S, TRAIN_LIMIT_S + _LONGER_S * self._lost_share)
        packets = int(limit_s * self._bit_rate_bps / (8 * BURST_LIMIT_BYTES))
        return max(1, min(_MOST_PACKETS, packets))

    def use_rate(self, bit_rate_bps: int) -> None:
        """Take the bit rate of a connection."""
        self._bit_rate_bps = bit_rate_bps

    def begins(self, record: SendStart, now: int, *, is_to_receiver: bool) -> None:
        """Take the beginning of a sound.

        Args:
            record: The sound.
            now: The instant.
            is_to_receiver: Whether burst data of its receiver are under way.
        """
        sound_us = min(record.delay_us + record.duration_us, _LONGEST_US)
        self.sounds_until = now + 1000 * sound_us
        if is_to_receiver and record.duration_us >= _LEAST_US:
            if self._is_unanswered:
                self._count(1.0)
            self._is_unanswered = True

    def is_delivered(self) -> None:
        """Record that packets of the last train have arrived."""
        if self._is_unanswered:
            self._is_unanswered = False
            self._count(0.0)

    def is_dropped(self) -> None:
        """Record that the last train is not repeated, and was perhaps not lost."""
        self._is_unanswered = False

    def _count(self, lost: float) -> None:
        self._lost_share += _LATELY * (lost - self._lost_share)
