"""The medium that all nodes of a scenario share: who hears what, when, and with which outcome.

Pure and seeded: no clock, no queue, no callback. A driver calls two methods in order of time::

    emission = medium.transmit(source, frame_bytes, now)    at any instant, never decreasing
    for arrival in emission.arrivals:                       … put on the driver's agenda …
        reception = medium.finish(arrival)                  at arrival.ends_at, in order of time

The same calls drive an event heap in virtual time and a loop on the wall clock, and give the same
receptions: every random draw belongs to (seed, source, node, number of the frame), none to the
order of a driver's calls. Arrivals that end at the same instant may be finished in any order. An
arrival at a node that has gone need not be finished; the medium forgets it ten minutes later.

All instants are ns since the start of the scenario. `hop` turns an emission into one arrival,
`receiver` decides its outcome.
"""

from zacoustic.channel.arrival import Arrival, Emission, Outcome, Reception
from zacoustic.channel.profiles import ModemProfile, profile_named
from zacoustic.channel.propagation.hop import Hop
from zacoustic.channel.propagation.position import Motion, Path, Position
from zacoustic.channel.propagation.receiver import Receiver
from zacoustic.channel.propagation.sea import ChannelModel, create_channel
from zacoustic.channel.scenario import NodeSpec, Scenario, check_position

# Drivers need the medium and its records together.
__all__ = ["Arrival", "Emission", "Medium", "Outcome", "Reception"]

_NS_PER_S = 1_000_000_000


class Medium:
    """The shared medium of one scenario.

    Args:
        scenario: Positions, modems and faults of the nodes.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        channels: dict[str, ChannelModel] = {}
        self._sites: dict[int, _Site] = {}
        for spec in scenario.nodes:
            name = scenario.profile_of(spec)
            if name not in channels:
                channels[name] = create_channel(
                    scenario.channel,
                    profile_named(name),
                    wind_m_s=scenario.wind_m_s,
                    shipping=scenario.shipping,
                )
            self._sites[spec.address] = _Site(spec, channels[name], scenario.collisions)

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of all nodes, in the order of the scenario."""
        return tuple(self._sites)

    @property
    def remembered(self) -> int:
        """Number of arrivals and emissions stored because something may still overlap them."""
        return sum(site.receiver.remembered for site in self._sites.values())

    def profile(self, address: int) -> ModemProfile:
        """Return the modem of a node.

        Raises:
            ValueError: No such node.
        """
        return self._site(address).profile

    def position(self, address: int, now: int) -> Position:
        """Return the position of a node at an instant: x east, y north, z down, m.

        Raises:
            ValueError: No such node.
        """
        return self._site(address).motion.position(now / _NS_PER_S)

    def move(self, address: int, position: Position, now: int) -> None:
        """Set the position of a node from now on: x east, y north, z down, m.

        Raises:
            ValueError: No such node, or a coordinate that is not a number or too large.
        """
        check_position("position", position)
        self._site(address).motion.move(position, now / _NS_PER_S)

    def path(self, source: int, node: int, now: int) -> Path:
        """Return distance, delay and range rate of sound from `source` to `node` at an instant.

        Raises:
            ValueError: Unknown nodes, the same node twice, or modems that cannot hear each other.
        """
        for hop in self._hops_of(self._site(source)):
            if hop.node == node:
                return hop.path(now)
        raise ValueError(f"no sound goes from {source} to {node}; nodes: {list(self._sites)}")

    def transmit(
        self,
        source: int,
        frame_bytes: int,
        now: int,
        *,
        airtime_ns: int | None = None,
        level_db: float = 0.0,
    ) -> Emission:
        """Let a node transmit a frame.

        Args:
            source: Address of the sender.
            frame_bytes: Length of the frame, bytes, 1…MTU of its modem.
            now: Instant of the first sound, ns, not before that of any earlier call.
            airtime_ns: Its duration, ns, for modems with several signals; `frame_bytes` may
                then have any value and decides how vulnerable it is. None: as the profile says.
            level_db: Source level relative to that of the profile, dB.

        Returns:
            The emission, with one arrival for each node that has a modem of the same kind and is
            not cut off by a blackout; give each to `finish`.

        Raises:
            ValueError: Unknown node, a frame that the modem cannot take, or the node is still
                transmitting.
        """
        site = self._site(source)
        profile = site.profile
        if airtime_ns is None:
            if not 1 <= frame_bytes <= profile.mtu_bytes:
                raise ValueError(
                    f"frame has {frame_bytes} bytes; "
                    f"allowed by {profile.name}: 1..{profile.mtu_bytes}"
                )
            airtime_ns = profile.airtime_ns(frame_bytes)
        if now < site.transmits_until and profile.half_duplex:
            raise ValueError(
                f"node {source} transmits until {site.transmits_until} ns; it is {now} ns"
            )
        ends_at = now + airtime_ns
        sequence = site.sequence
        site.sequence += 1
        site.transmits_until = ends_at
        site.receiver.transmits(now, ends_at)
        arrivals = []
        unheard: tuple[int, ...] = ()
        for hop in self._hops_of(site):
            arrival = hop.arrival(sequence, frame_bytes, now, airtime_ns, level_db)
            if hop.is_dark(arrival):
                unheard += (hop.node,)
                continue
            receiver = self._sites[hop.node].receiver
            is_decodable = receiver.profile is profile
            receiver.expect(arrival, now, is_decodable=is_decodable)
            if is_decodable:
                arrivals.append(arrival)
        return Emission(
            source=source,
            sequence=sequence,
            frame_bytes=frame_bytes,
            started_at=now,
            ends_at=ends_at,
            ready_at=ends_at + profile.gap_ns,
            arrivals=tuple(arrivals),
            unheard=unheard,
        )

    def finish(self, arrival: Arrival) -> Reception:
        """Return the outcome of an arrival; call it once, when the arrival ends.

        Raises:
            ValueError: Unknown node, or an arrival that is finished already.
        """
        site = self._sites.get(arrival.node) or self._site(arrival.node)
        return site.receiver.judge(arrival)

    def _site(self, address: int) -> "_Site":
        try:
            return self._sites[address]
        except KeyError:
            raise ValueError(f"node is {address}; nodes: {list(self._sites)}") from None

    def _hops_of(self, site: "_Site") -> "tuple[Hop, ...]":
        """Return the hops to all nodes that hear this one."""
        # Made on first use: a generator takes 2.5 kB, and most of 254 nodes never transmit.
        if site.hops is None:
            site.hops = tuple(
                self._hop(site, other)
                for other in self._sites.values()
                if other is not site and other.profile.overlaps_band_of(site.profile)
            )
        return site.hops

    def _hop(self, site: "_Site", other: "_Site") -> Hop:
        scenario = self.scenario
        return Hop(
            seed=scenario.seed,
            source=site.address,
            node=other.address,
            channel=site.channel,
            sender=site.motion,
            receiver=other.motion,
            sound_speed_m_s=scenario.sound_speed_m_s,
            loss=scenario.loss_between(site.address, other.address),
            faults=scenario.faults,
            gain_db=scenario.gain_db_between(site.address, other.address),
            propagation_s=scenario.delay_s,
            recorded=scenario.recorded,
        )


class _Site:
    """The state of one node in the medium."""

    def __init__(self, spec: NodeSpec, channel: ChannelModel, collisions: str) -> None:
        self.address = spec.address
        self.profile = channel.profile
        self.channel = channel
        self.motion: Motion = spec.motion()
        self.receiver = Receiver(channel, collisions)
        self.sequence = 0
        self.transmits_until = 0
        self.hops: tuple[Hop, ...] | None = None
