"""The channel between the nodes of the stand-in: who receives a packet, and when.

Two kinds of channel, for one driver (`zacoustic.channel.driver`):

- `SampleChannel`, as measured with DESERT's sample script: all nodes 500 m apart, modems of
  48 kbit/s. A packet is lost at a node that transmits when it begins to arrive; a share is lost at
  random. Sound that begins while a packet arrives does no harm: this reproduces the measured losses
  of 0.01 for 64 bytes and 0.15 for 512, with two packets a second in each direction.
- the `Medium` of a scenario file (`medium_of`): places, modem profiles, noise, collisions, faults.

Pure and seeded: instants are arguments and never decrease.
"""

import random
from typing import Final

from zacoustic.channel.medium import Arrival, Emission, Medium, Outcome, Reception
from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import seconds_to_ns
from zacoustic.errors import ConfigError
from zacoustic_desert.config import HEADER_BYTES, READ_LIMIT_BYTES

SAMPLE_PROPAGATION_S: Final = 500.0 / 1500.0
"""Propagation delay between the nodes of the sample, s."""
SAMPLE_BIT_RATE_BPS: Final = 48_000.0
"""Bit rate of the sample's modems, bit/s."""


class SampleChannel:
    """The channel of DESERT's sample script.

    Args:
        nodes: Number of nodes.
        rng: Decides which packets are lost.
        loss: Share of the packets lost at random, 0…1.
        propagation_s: Propagation delay between any two nodes, s.
        bit_rate_bps: Bit rate of the modems, bit/s.
        half_duplex: A transmitting node loses packets, as measured.
    """

    def __init__(
        self,
        nodes: int,
        rng: random.Random,
        *,
        loss: float = 0.0,
        propagation_s: float = SAMPLE_PROPAGATION_S,
        bit_rate_bps: float = SAMPLE_BIT_RATE_BPS,
        half_duplex: bool = True,
    ) -> None:
        if not 0 <= loss <= 1:
            raise ConfigError(f"loss is {loss:g}; allowed: 0..1")
        self._rng = rng
        self._loss = loss
        self._propagation_s = propagation_s
        self._bit_rate_bps = bit_rate_bps
        self._longest_ns = self._airtime_ns(READ_LIMIT_BYTES)
        self._half_duplex = half_duplex
        self._sequence = 0
        # For each node, its transmissions during which something may still arrive.
        self._transmits: list[list[tuple[int, int]]] = [[] for _ in range(nodes)]

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of all nodes, from 0."""
        return tuple(range(len(self._transmits)))

    def transmit(self, source: int, frame_bytes: int, now: int) -> Emission:
        """Let a node transmit a packet."""
        airtime_ns = self._airtime_ns(frame_bytes)
        ends_at = now + airtime_ns
        recent = self._transmits[source]
        # Arrivals without an outcome have not ended, and began at most the largest duration ago.
        oldest_at = now - self._longest_ns
        recent[:] = [each for each in recent if each[1] > oldest_at]
        recent.append((now, ends_at))
        self._sequence += 1
        starts_at = now + seconds_to_ns(self._propagation_s)
        return Emission(
            source=source,
            sequence=self._sequence,
            frame_bytes=frame_bytes,
            started_at=now,
            ends_at=ends_at,
            ready_at=ends_at,
            arrivals=tuple(
                Arrival(
                    node=node,
                    source=source,
                    sequence=self._sequence,
                    frame_bytes=frame_bytes,
                    starts_at=starts_at,
                    ends_at=starts_at + airtime_ns,
                    propagation_s=self._propagation_s,
                    # This channel has no levels.
                    distance_m=0.0, received_level_db=0.0, snr_db=0.0, effective_snr_db=0.0,
                    chance=0.0,
                )
                for node in self.addresses
                if node != source
            ),
        )  # fmt: skip

    def finish(self, arrival: Arrival) -> Reception:
        """Return the outcome of an arrival."""
        # Always drawn, so that the outcome of later packets does not depend on this one's.
        outcome = Outcome.NOISE if self._rng.random() < self._loss else Outcome.RECEIVED
        if self._half_duplex and any(
            began <= arrival.starts_at < ended for began, ended in self._transmits[arrival.node]
        ):
            outcome = Outcome.HALF_DUPLEX
        return Reception(arrival=arrival, outcome=outcome, sinr_db=0.0)

    def _airtime_ns(self, payload_bytes: int) -> int:
        return seconds_to_ns((payload_bytes + HEADER_BYTES) * 8 / self._bit_rate_bps)


def medium_of(scenario: Scenario, max_read_length: int) -> Medium:
    """Return the channel of a scenario; its nodes, in order, are those of the stand-in.

    The headers of DESERT count as part of the modems' preamble.

    Args:
        scenario: Positions, modems and faults of the nodes.
        max_read_length: Largest packet, bytes: DESERT's modems do not split one.

    Raises:
        ConfigError: A modem of the scenario cannot take such a packet.
    """
    medium = Medium(scenario)
    for address in medium.addresses:
        profile = medium.profile(address)
        if profile.mtu_bytes < max_read_length:
            raise ConfigError(
                f"modem {profile.name} of node {address} takes {profile.mtu_bytes} bytes; "
                f"max_read_length is {max_read_length}",
                hint="choose another profile, or packets that fit it",
            )
    return medium
