"""Scenarios: the channel, the nodes and the faults; frozen, checked, with all defaults.

A scenario is parsed elsewhere (JSON5) into a plain mapping, and becomes a `Scenario` by
`scenario_from_mapping`::

    { seed: 7, sound_speed_m_s: 1500, wind_m_s: 5, shipping: 0.5,
      profile: "evologics_s2c_18_34", channel: "sea", collisions: "capture",
      nodes: [ { address: 1, name: "shore", position: [0, 0, 10] },
               { address: 2, track: [ { t: 0, position: [1000, 0, 50] },
                                      { t: 600, position: [1000, 900, 50] } ] } ],
      loss: { frame: 0.1, burst_frames: 4 },
      links: [ { from: 1, to: 2, loss: { frame: 0.3 } } ],
      faults: { corrupt: 0.001, duplicate: 0.01, jitter_s: 0.2,
                blackouts: [ { pair: [1, 2], from_s: 600, to_s: 900, every_s: 3600 } ],
                crashes: [ { node: 2, at_s: [700, 2000], restart_after_s: 20 } ] } }

`channel` is the channel model (`sea`). `loss` drops frames in addition and independently: with
``channel: "none"`` only `loss` does. A direction in `links` has its own loss or level. `media` has
the channels of further links of the nodes. `faults` contains all other faults.

A typo is an error that names the key. Each record checks itself when it is made, also from Python;
every message begins with the key and names the value and the allowed values.
"""

import itertools
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec

from zacoustic.channel.faults.blackout import BlackoutSpec
from zacoustic.channel.faults.faults import FaultSpec
from zacoustic.channel.faults.limits import check_range
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.problem import explain
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.propagation.position import Motion, Position, Waypoint, distance_m
from zacoustic.channel.recorded import RecordedSpec, with_recording
from zacoustic.channel.tracks import with_tracks
from zacoustic.channel.traffic import TrafficSpec
from zacoustic.errors import ConfigError

ChannelName = Literal["sea", "awgn", "none", "desert", "recorded"]
"""The channel models: see `zacoustic.channel.propagation.sea`."""

CollisionRule = Literal["capture", "protocol", "sinr"]
"""Effect of an overlap: see `zacoustic.channel.propagation.receiver`."""

_MAX_WIND_M_S: Final = 60.0  # a hurricane; Wenz's curves end near 20
_MIN_SOUND_SPEED_M_S: Final = 1000.0
_MAX_SOUND_SPEED_M_S: Final = 2000.0
_MAX_COORDINATE_M: Final = 1.0e6  # beyond it the earth is not flat, and no modem reaches
_MAX_SPEED_M_S: Final = 100.0  # far above any vehicle, far below sound
_MAX_DELAY_S: Final = 60.0
_MAX_TIME_S: Final = 1.0e9  # thirty years
_MANY_PLACES: Final = 64


class LinkSpec(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    rename={"source": "from", "target": "to"},
):
    """One direction between two nodes that differs from the others."""

    source: int
    """Address of the sender; `from` in the file."""
    target: int
    """Address of the receiver; `to` in the file."""
    loss: LossSpec | None = None
    """Loss in this direction; None: the scenario's."""
    gain_db: float = 0.0
    """Gain of this direction over the channel model, dB, −100…100; usually negative."""

    def __post_init__(self) -> None:
        """Check the range.

        Raises:
            ValueError: A value outside its range.
        """
        check_range("gain_db", self.gain_db, -100.0, 100.0)


class NodeSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One node: its address, its modem, and its position."""

    address: int
    """1…254."""
    name: str = ""
    """Name for people; may be empty."""
    position: Position | None = None
    """x east, y north, z down, m; or a track."""
    track: tuple[Waypoint, ...] | None = None
    """Way-points, times strictly increasing; or a position."""
    profile: str | None = None
    """Modem of this node; None: the scenario's."""

    def __post_init__(self) -> None:
        """Check address, place and profile.

        Raises:
            ValueError: Address outside 1…254, not exactly one of position and track, an empty
                track, times that do not increase, a coordinate that is no number, or an unknown
                profile.
        """
        if not 1 <= self.address <= 254:
            raise ValueError(f"address is {self.address}; allowed: 1..254")
        if self.position is None and self.track is None:
            raise ValueError("position is missing; allowed: exactly one of position and track")
        if self.position is not None and self.track is not None:
            raise ValueError("track is given beside position; allowed: exactly one of the two")
        if self.position is not None:
            check_position("position", self.position)
        if self.track is not None:
            _check_track(self.track)
        if self.profile is not None:
            profile_named(self.profile)

    def motion(self) -> Motion:
        """Return the position of the node over time."""
        if self.position is not None:
            return Motion.fixed(self.position)
        assert self.track is not None
        return Motion(self.track)


class MediumSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The channel of a further link: what differs from that of the first one."""

    link: str
    """Name of the link in the config."""
    profile: str | None = None
    """Modem of all nodes; None: as on the first link."""
    channel: ChannelName | None = None
    """The channel model; None: that of the scenario."""
    collisions: CollisionRule | None = None
    """Effect of an overlap; None: that of the scenario."""
    delay_s: float | None = None
    """One propagation delay between all nodes, s, 0…60; None: that of the scenario."""
    loss: LossSpec = LossSpec()
    """Frames lost in addition to those that the channel loses."""
    links: tuple[LinkSpec, ...] = ()
    """Directions with a loss or a level of their own."""
    blackouts: tuple[BlackoutSpec, ...] = ()
    """When nothing passes, such as a radio while a vehicle dives."""


class Scenario(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The channel and its nodes."""

    nodes: tuple[NodeSpec, ...]
    """At least one; addresses are unique."""
    seed: int = 1
    """Determines every random draw."""
    sound_speed_m_s: float = 1500.0
    """Speed of sound, m/s, 1000…2000."""
    wind_m_s: float = 5.0
    """Wind speed, m/s, 0…60; causes the noise of waves."""
    shipping: float = 0.5
    """Activity of distant ships, 0…1."""
    delay_s: float | None = None
    """One propagation delay between all nodes, s, 0…60, instead of the geometric one: the
    assumption of the throughput formulae of carrier sense. None: distance / sound speed."""
    profile: str = DEFAULT_PROFILE
    """Modem of the nodes that name none."""
    channel: ChannelName = "sea"
    """The channel model."""
    recorded: RecordedSpec | None = None
    """The recording, for the channel model ``recorded`` only."""
    collisions: CollisionRule = "capture"
    """Effect of an overlap on a frame."""
    loss: LossSpec = LossSpec()
    """Frames lost in addition to those that the channel loses."""
    links: tuple[LinkSpec, ...] = ()
    """Directions with a loss or a level of their own."""
    media: tuple[MediumSpec, ...] = ()
    """The channels of further links; a link without one has the scenario's, for itself."""
    faults: FaultSpec = FaultSpec()
    """All other faults; a medium applies those of frames and blackouts, `zacoustic sim` all."""
    config: str = ""
    """Config of the fleet for `zacoustic sim`, relative to the scenario; empty: opaque topics."""
    traffic: tuple[TrafficSpec, ...] = ()
    """Traffic for `zacoustic sim`; a medium ignores it."""

    def __post_init__(self) -> None:
        """Check the ranges, and that addresses match.

        Raises:
            ValueError: A value outside its range, no node, a repeated address, or a link or fault
                of an unknown node.
        """
        check_range(
            "sound_speed_m_s", self.sound_speed_m_s, _MIN_SOUND_SPEED_M_S, _MAX_SOUND_SPEED_M_S
        )
        check_range("wind_m_s", self.wind_m_s, 0.0, _MAX_WIND_M_S)
        check_range("shipping", self.shipping, 0.0, 1.0)
        if self.delay_s is not None:
            check_range("delay_s", self.delay_s, 0.0, _MAX_DELAY_S)
        profile_named(self.profile)
        if (self.channel == "recorded") != (self.recorded is not None):
            there = "there" if self.recorded is not None else "missing"
            raise ValueError(
                f'recorded is {there} and channel is "{self.channel}"; '
                'allowed: recorded with channel: "recorded"'
            )
        self._check_nodes()
        self._check_links()
        self._check_media()
        addresses = {node.address for node in self.nodes}
        for key, address in self.faults.nodes():
            if address not in addresses:
                raise ValueError(f"faults.{key} is {address}; allowed: the address of a node")

    def loss_between(self, source: int, target: int) -> LossSpec:
        """Return the named loss of one direction: its own, or the scenario's."""
        for link in self.links:
            if (link.source, link.target) == (source, target) and link.loss is not None:
                return link.loss
        return self.loss

    def gain_db_between(self, source: int, target: int) -> float:
        """Return the gain of one direction over the channel model, dB."""
        for link in self.links:
            if (link.source, link.target) == (source, target):
                return link.gain_db
        return 0.0

    @property
    def farthest_s(self) -> float:
        """Longest propagation delay, one way, between any two nodes, wherever they go, s.

        For a long track, which would take minutes, it is an upper bound from the enclosing box.
        """
        if self.delay_s is not None:
            return self.delay_s
        routes = [_corners(node.motion().places) for node in self.nodes]
        farthest_m = max(
            (
                distance_m(one, other)
                for first, second in itertools.combinations(routes, 2)
                for one in first
                for other in second
            ),
            default=0.0,
        )
        return farthest_m / self.sound_speed_m_s

    def medium_of(self, link: str) -> "Scenario":
        """Return the scenario of a further link: the same nodes at the same places."""
        spec = next((each for each in self.media if each.link == link), MediumSpec(link=link))
        nodes = self.nodes
        if spec.profile is not None:
            nodes = tuple(msgspec.structs.replace(each, profile=None) for each in nodes)
        return msgspec.structs.replace(
            self,
            nodes=nodes,
            seed=random.Random(f"{self.seed}/{link}").getrandbits(32),
            profile=spec.profile or self.profile,
            channel=spec.channel or self.channel,
            recorded=None if spec.channel is not None else self.recorded,
            collisions=spec.collisions or self.collisions,
            delay_s=self.delay_s if spec.delay_s is None else spec.delay_s,
            loss=spec.loss,
            links=spec.links,
            media=(),
            faults=msgspec.structs.replace(self.faults, blackouts=spec.blackouts),
        )

    def profile_of(self, node: NodeSpec) -> str:
        """Return the name of a node's profile: its own, or the scenario's."""
        return node.profile or self.profile

    def _check_nodes(self) -> None:
        if not self.nodes:
            raise ValueError("nodes is empty; allowed: at least one node")
        seen: dict[int, int] = {}
        for index, node in enumerate(self.nodes):
            first = seen.setdefault(node.address, index)
            if first != index:
                raise ValueError(
                    f"nodes[{index}].address is {node.address}; "
                    f"allowed: an address that nodes[{first}] does not have"
                )

    def _check_media(self) -> None:
        seen: set[str] = set()
        for index, medium in enumerate(self.media):
            if not medium.link or medium.link in seen:
                raise ValueError(
                    f"media[{index}].link is {medium.link!r}; allowed: a link, each once"
                )
            seen.add(medium.link)
            try:
                self.medium_of(medium.link)
            except ConfigError as error:
                raise ValueError(f"media[{index}].{error.args[0]}") from error
            except ValueError as error:
                raise ValueError(f"media[{index}].{error.args[0]}") from error

    def _check_links(self) -> None:
        addresses = {node.address for node in self.nodes}
        seen: set[tuple[int, int]] = set()
        for index, link in enumerate(self.links):
            for key, address in (("from", link.source), ("to", link.target)):
                if address not in addresses:
                    raise ValueError(
                        f"links[{index}].{key} is {address}; allowed: the address of a node"
                    )
            if link.source == link.target:
                raise ValueError(f"links[{index}].to is {link.target}; allowed: another node")
            if (link.source, link.target) in seen:
                raise ValueError(
                    f"links[{index}].to is {link.target}; "
                    f"allowed: each direction once, and from {link.source} it is there"
                )
            seen.add((link.source, link.target))


def scenario_from_mapping(mapping: object, *, source: str, folder: Path | None = None) -> Scenario:
    """Convert a parsed scenario file.

    Args:
        mapping: Nested mappings, arrays, strings and numbers; anything else is an error.
        source: Name of the file for messages.
        folder: Folder of tracks and recordings; None: the scenario may name none.

    Returns:
        The scenario, checked.

    Raises:
        ConfigError: One line: file, key path, value, allowed values.
    """
    if folder is not None:
        mapping = with_recording(with_tracks(mapping, folder), folder)
    try:
        return msgspec.convert(mapping, Scenario)
    except (msgspec.ValidationError, OverflowError) as error:
        problem = explain(error, mapping, Scenario)
        hint = _CONFIG_HINT if isinstance(mapping, dict) and "plugins" in mapping else ""
        raise ConfigError(f"{source}: {problem}", hint=hint) from None


_CONFIG_HINT: Final = (
    "it looks like the config of a node; a scenario names it: config: FILE, nodes: [ … ]"
)


def check_position(key: str, position: Position) -> None:
    """Check a position.

    Raises:
        ValueError: A coordinate is not a number, or too large.
    """
    for index, coordinate in enumerate(position):
        check_range(f"{key}[{index}]", coordinate, -_MAX_COORDINATE_M, _MAX_COORDINATE_M)


def _corners(places: Sequence[Position]) -> Sequence[Position]:
    """Return the places of a track, or the corners of the box around many."""
    if len(places) <= _MANY_PLACES:
        return places
    (x0, x1), (y0, y1), (z0, z1) = ((min(axis), max(axis)) for axis in zip(*places, strict=True))
    return list(itertools.product((x0, x1), (y0, y1), (z0, z1)))


def _check_track(track: tuple[Waypoint, ...]) -> None:
    if not track:
        raise ValueError("track is []; allowed: at least one way-point")
    for index, waypoint in enumerate(track):
        check_position(f"track[{index}].position", waypoint.position)
        check_range(f"track[{index}].t", waypoint.t, -_MAX_TIME_S, _MAX_TIME_S)
        if index and not waypoint.t > track[index - 1].t:
            raise ValueError(
                f"track[{index}].t is {waypoint.t!r}; "
                f"allowed: above track[{index - 1}].t, {track[index - 1].t!r}"
            )
        if index:
            before = track[index - 1]
            speed = distance_m(before.position, waypoint.position) / (waypoint.t - before.t)
            if speed > _MAX_SPEED_M_S:
                raise ValueError(
                    f"track[{index}].t is {waypoint.t!r}, which makes {speed:.0f} m/s; "
                    f"allowed: at most {_MAX_SPEED_M_S:g} m/s"
                )
