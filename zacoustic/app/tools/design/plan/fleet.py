"""The inputs of a plan: the channel, the tables and rules of its nodes, and their traffic.

The file is a scenario with traffic, which has all of that; or a config, whose nodes are then placed
in a channel: in a row, at a distance, with a loss.
"""

from collections.abc import Hashable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.offers import (
    Offer,
    offers_of_config,
    offers_of_recording,
    offers_of_traffic,
)
from zacoustic.app.tools.design.plan.sampling import members_of, spoken
from zacoustic.app.tools.design.plan.tables import among, in_bytes, respecified
from zacoustic.app.tools.design.sim.fleetrun import links_of
from zacoustic.app.tools.design.sim.sealing import security_of
from zacoustic.app.tools.design.sim.simulation import with_journals
from zacoustic.app.tools.design.telemetry.recording import read_recordings
from zacoustic.app.tools.fleetfile import read_fleet
from zacoustic.app.tools.fleets import configs_of, tables_of
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import MediumSpec, NodeSpec, Scenario, scenario_from_mapping
from zacoustic.config import Config, read_config
from zacoustic.config.json5 import read_json5, read_zenoh_config
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.wire.seal import LONG_HEAD_BYTES, STRONG_TAG_BYTES
from zacoustic.errors import ConfigError
from zacoustic.seal.spec import SecuritySpec

DEFAULT_RANGE_M: Final = 1000.0
"""Distance of the nodes of a config, m."""
_WINDOW_S: Final = 10.0


class Refused(msgspec.Struct, frozen=True, kw_only=True):
    """Samples that their publisher would have refused."""

    share: float
    """Share of all samples of the stream, 0…1."""
    reason: str
    """Reason for the first."""


class Fleet(msgspec.Struct, kw_only=True):
    """The inputs of a walk."""

    scenario: Scenario
    """The channel."""
    tables: dict[int, StreamTable]
    """The streams of each modelled node."""
    rules: dict[int, TransmitRules]
    """The config's rules of transmission."""
    offers: list[Offer]
    """The offered traffic."""
    security: dict[int, SecuritySpec] = {}
    """The seal of each node that has one."""
    notes: list[str]
    """Remarks on the traffic."""
    refused: dict[int, Refused] = {}
    """Recorded samples that their types refuse, by stream id."""
    apart_m: float | None = None
    """Assumed distance of each two nodes, m; None: the scenario has their places."""
    members: dict[int, tuple[int, ...]] = {}
    """Nodes represented by each modelled node, itself included; empty: each represents itself."""

    @property
    def nodes(self) -> list[int]:
        """Addresses of all nodes."""
        stood_for = (each for group in self.members.values() for each in group)
        return sorted({*self.tables, *stood_for})


class AssumedChannel(msgspec.Struct, frozen=True, kw_only=True):
    """Positions for the nodes of a config, which has none."""

    profile: str = DEFAULT_PROFILE
    """Modem."""
    others: Mapping[str, str] = {}
    """Modem of links other than the first, by their names; without one it is the same."""
    range_m: float = DEFAULT_RANGE_M
    """Distance from the first node to each other one, m."""
    loss: float = 0.0
    """Share of frames lost in addition to the channel's losses, 0…1."""


def fleet_of(path: Path, recordings: Sequence[str], channel: AssumedChannel) -> Fleet:
    """Read a scenario or a config, and perhaps recordings.

    Raises:
        ConfigError: One of them is wrong, or no rates are known.
    """
    mapping = read_json5(path)
    is_config = isinstance(mapping, Mapping) and "nodes" not in mapping
    fleet = (
        _of_config(path, channel, with_values=bool(recordings))
        if is_config
        else _of_scenario(path, mapping)
    )
    table = next(iter(fleet.tables.values()))
    if recordings:
        ros = read_fleet(path).ros if is_config else None
        found = read_recordings(recordings, table, only_dense=False, window_s=_WINDOW_S, ros=ros)
        fleet.notes = list(found.notes)
        fleet.offers = offers_of_recording(found.missions, table, list(fleet.tables))
        fleet.refused = {
            stream_id: Refused(
                share=count.refused / (count.refused + count.samples), reason=count.reason
            )
            for stream_id, count in found.counts.items()
            if count.refused
        }
        heard = {offer.stream.stream_id for offer in fleet.offers}
        fleet.notes += [
            f"{stream.name}: not in the recording: left out"
            for stream in table
            if stream.stream_id not in heard
        ]
    if not fleet.offers:
        raise ConfigError(
            f"{path}: no traffic rates",
            hint="give topics min_interval_s or deadline_s, or --recording, or a scenario with "
            "traffic",
        )
    return fleet


def _of_scenario(path: Path, mapping: object) -> Fleet:
    scenario = scenario_from_mapping(mapping, source=str(path), folder=path.parent)
    configs = configs_of(scenario, path)
    scenario = with_journals(scenario, configs)
    tables = tables_of(scenario, configs, str(path))
    return Fleet(
        scenario=scenario,
        tables=tables,
        rules=_rules(tables, configs),
        security=security_of(configs),
        offers=offers_of_traffic(scenario.traffic, next(iter(tables.values()))),
        notes=[],
    )


def _of_config(path: Path, channel: AssumedChannel, *, with_values: bool) -> Fleet:
    first = read_fleet(path)
    addresses = sorted(first.nodes) or _two_of(first.address)
    members = members_of(first.table, first.rules, _settings_of(path, addresses))
    configs = {address: read_config(path, address=address) for address in members}
    _, *known = links_of({address: config.rules for address, config in configs.items()})
    for link in channel.others:
        if link not in known:
            raise ConfigError(
                f"{path}: it has no further link {link}; allowed: {', '.join(known) or 'none'}"
            )
    scenario = Scenario(
        nodes=tuple(
            NodeSpec(address=address, position=(0.0 if not index else channel.range_m, 0.0, 10.0))
            for index, address in enumerate(members)
        ),
        profile=profile_named(channel.profile).name,
        loss=LossSpec(frame=channel.loss),
        media=tuple(
            MediumSpec(link=link, profile=profile_named(profile).name)
            for link, profile in channel.others.items()
        ),
    )
    tables = {address: config.table for address, config in configs.items()}
    room_bytes = profile_named(channel.profile).mtu_bytes
    if any(config.security is not None for config in configs.values()):
        room_bytes -= LONG_HEAD_BYTES + STRONG_TAG_BYTES
    offers, notes = offers_of_config(first.table, addresses, first.typical_bits, room_bytes)
    sized = {
        each.stream.stream_id: partial(in_bytes, voices=_voices(each.stream, members))
        for each in offers
    }
    if len(members) < len(addresses):
        tables = {address: among(table, members) for address, table in tables.items()}
    if not with_values:
        tables = {address: respecified(table, sized) for address, table in tables.items()}
    table = next(iter(tables.values()))
    offers = [each.altered(table.by_id(each.stream.stream_id), each.every_s) for each in offers]
    return Fleet(
        scenario=scenario,
        tables=tables,
        rules=_rules(tables, configs),
        security=security_of(configs),
        offers=spoken(offers, members),
        notes=notes,
        apart_m=channel.range_m,
        members=members,
    )


def _voices(stream: Stream, members: Mapping[int, tuple[int, ...]]) -> int:
    """Return for how many nodes one of them publishes a topic at most."""
    return max(len(group) for each, group in members.items() if stream.may_publish(each))


def _settings_of(path: Path, addresses: Sequence[int]) -> dict[int, Hashable]:
    """Return what a config, already read, says of each node besides address and name."""
    _, section = read_zenoh_config(path)
    nodes = section.get("nodes") if isinstance(section, Mapping) else None
    settings: dict[int, Hashable] = dict.fromkeys(addresses)
    for entry in nodes or ():
        told = {key: value for key, value in entry.items() if key not in ("address", "name")}
        settings[entry["address"]] = repr(sorted(told.items()))
    return settings


def _two_of(address: int) -> list[int]:
    return sorted({address, 1 if address != 1 else 2})


def _rules(
    tables: Mapping[int, StreamTable], configs: Mapping[int, Config]
) -> dict[int, TransmitRules]:
    return {
        address: configs[address].rules if address in configs else TransmitRules()
        for address in tables
    }
