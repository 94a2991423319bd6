"""What lies between the nodes of the stand-in: who hears a packet, when, and whether at all.

Two kinds of channel, for one driver:

- `SampleChannel`, as measured with DESERT's sample script: every node 500 m from every other,
  modems of 48 kbit/s, packets lost at a node that transmits when they begin to arrive, and a share
  at random. What begins while a packet arrives does no harm: that is how the measured losses come
  out, 0.01 for 64 bytes and 0.15 for 512 with two packets a second each way.
- `ScenarioChannel`, the channel model of this project with a scenario file: places, modem profiles,
  noise, collisions, faults.

Pure and seeded: instants come in, and never decrease.
"""

import random
from typing import Final, Protocol

import msgspec

from zacoustic.channel.faults import corrupt
from zacoustic.channel.medium import Arrival, Medium
from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import seconds_to_ns
from zacoustic.errors import ConfigError
from zacoustic_desert.config import HEADER_BYTES, READ_LIMIT_BYTES

SAMPLE_PROPAGATION_S: Final = 500.0 / 1500.0
"""Between the nodes of the sample, s."""
SAMPLE_BIT_RATE_BPS: Final = 48_000.0
"""Of the modems of the sample, bit/s."""


class Landing(msgspec.Struct, frozen=True, kw_only=True):
    """A packet on its way to one node."""

    node: int
    """Index of the node, from 0."""
    starts_at: int
    """Instant at which it begins to arrive, ns."""
    ends_at: int
    """Instant of its arrival, ns; the driver calls `Channel.finish` then."""
    arrival: Arrival | None = None
    """What the channel model calls it."""


class Flight(msgspec.Struct, frozen=True, kw_only=True):
    """A packet that leaves a node."""

    ready_at: int
    """Instant from which the modem takes the next one, ns."""
    landings: tuple[Landing, ...]
    """Where it arrives."""


class Landed(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a packet at a node."""

    payload: bytes = b""
    """What the node has received."""
    repeats_after_ns: tuple[int, ...] = ()
    """When it receives the same again."""
    lost: str = ""
    """Why nothing was received; empty if something was."""


class Channel(Protocol):
    """Who hears a packet, when, and whether at all."""

    nodes: int
    """Number of nodes."""

    def transmit(self, source: int, payload_bytes: int, now: int) -> Flight:
        """Let a node transmit a packet; `now` never decreases."""
        ...

    def finish(self, landing: Landing, payload: bytes) -> Landed:
        """Return the outcome of a landing; called once, when it ends, in order of time."""
        ...


class SampleChannel:
    """Water as in DESERT's sample script.

    Args:
        nodes: Number of nodes.
        rng: Decides which packets are lost.
        loss: Share of the packets that is lost at random, 0…1.
        propagation_s: Between any two nodes, s.
        bit_rate_bps: Of the modems, bit/s.
        half_duplex: Packets are lost at a node that transmits; the loss that was measured.
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
        self.nodes = nodes
        self._rng = rng
        self._loss = loss
        self._propagation_ns = seconds_to_ns(propagation_s)
        self._bit_rate_bps = bit_rate_bps
        self._longest_ns = self._airtime_ns(READ_LIMIT_BYTES)
        self._half_duplex = half_duplex
        # For each node, its transmissions that something may still arrive in.
        self._transmits: list[list[tuple[int, int]]] = [[] for _ in range(nodes)]

    def transmit(self, source: int, payload_bytes: int, now: int) -> Flight:
        """Let a node transmit a packet."""
        airtime_ns = self._airtime_ns(payload_bytes)
        ends_at = now + airtime_ns
        recent = self._transmits[source]
        # Landings without an outcome have not ended, and began at most the largest duration ago.
        oldest_at = now - self._longest_ns
        recent[:] = [each for each in recent if each[1] > oldest_at]
        recent.append((now, ends_at))
        starts_at = now + self._propagation_ns
        return Flight(
            ready_at=ends_at,
            landings=tuple(
                Landing(node=node, starts_at=starts_at, ends_at=starts_at + airtime_ns)
                for node in range(self.nodes)
                if node != source
            ),
        )

    def finish(self, landing: Landing, payload: bytes) -> Landed:
        """Return what became of a landing."""
        # Drawn always, so that the fate of later packets does not depend on this one's.
        is_lost = self._rng.random() < self._loss
        if self._half_duplex and any(
            began <= landing.starts_at < ended for began, ended in self._transmits[landing.node]
        ):
            return Landed(lost="half_duplex")
        return Landed(lost="loss") if is_lost else Landed(payload=payload)

    def _airtime_ns(self, payload_bytes: int) -> int:
        return seconds_to_ns((payload_bytes + HEADER_BYTES) * 8 / self._bit_rate_bps)


class ScenarioChannel:
    """The channel of a scenario; its nodes in their order are those of the stand-in.

    Args:
        scenario: Who is where, with which modem, and what goes wrong.
        max_read_length: Largest packet, bytes: DESERT's modems do not split one.

    Raises:
        ConfigError: A modem of the scenario does not take such a packet.
    """

    def __init__(self, scenario: Scenario, max_read_length: int) -> None:
        self._medium = Medium(scenario)
        self._addresses = self._medium.addresses
        self.nodes = len(self._addresses)
        for address in self._addresses:
            profile = self._medium.profile(address)
            if profile.mtu_bytes < max_read_length:
                raise ConfigError(
                    f"modem {profile.name} of node {address} takes {profile.mtu_bytes} bytes; "
                    f"max_read_length is {max_read_length}",
                    hint="choose another profile, or packets that fit it",
                )

    def transmit(self, source: int, payload_bytes: int, now: int) -> Flight:
        """Let a node transmit a packet; the headers count as part of the profile's preamble."""
        emission = self._medium.transmit(self._addresses[source], payload_bytes, now)
        return Flight(
            ready_at=emission.ready_at,
            landings=tuple(
                Landing(
                    node=self._addresses.index(arrival.node),
                    starts_at=arrival.starts_at,
                    ends_at=arrival.ends_at,
                    arrival=arrival,
                )
                for arrival in emission.arrivals
            ),
        )

    def finish(self, landing: Landing, payload: bytes) -> Landed:
        """Return what became of a landing."""
        assert landing.arrival is not None
        reception = self._medium.finish(landing.arrival)
        if not reception.is_received:
            return Landed(lost=reception.outcome.value)
        if reception.corrupt_seed is not None:
            payload = corrupt(payload, random.Random(reception.corrupt_seed))
        return Landed(
            payload=payload,
            repeats_after_ns=tuple(seconds_to_ns(each) for each in reception.duplicates_after_s),
        )
