"""The possible changes of `zacoustic replay --what-if`: losses, config, access, codec, channel."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.gathering import gather
from zacoustic.app.tools.inspect.recordings.replaying.today import configs_for
from zacoustic.app.tools.inspect.recordings.whatif.measuredchannel import measure_channel, with_loss
from zacoustic.app.tools.inspect.recordings.whatif.whatif import Change, WhatIf, compare, configured
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.config import Config
from zacoustic.config.json5 import read_json5
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import AlohaSpec, CarrierSenseSpec, DelegatedSpec
from zacoustic.core.streams.specs import DENSE, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ConfigError
from zacoustic.run.recording.epochs import no_engine
from zacoustic.run.recording.life import Table

ACCESS: Final = {
    "aloha": AlohaSpec(),
    "carrier_sense": CarrierSenseSpec(),
    "delegated": DelegatedSpec(),
}
"""Medium accesses without settings; others come with a configuration."""
CODECS: Final = ("cbor", "packed", "dense")


class Wanted(msgspec.Struct, frozen=True, kw_only=True):
    """The changes; by default none."""

    add_loss: float = 0.0
    """Added share of lost frames, in every direction."""
    loss: float | None = None
    """Share of lost frames, in place of the recorded one."""
    config: str | None = None
    """Configuration of all nodes."""
    access: str | None = None
    """Medium access, one of `ACCESS`."""
    codec: str | None = None
    """Codec of all typed topics that allow it, one of `CODECS`."""
    scenario: str | None = None
    """The channel, in place of the measured one, in all runs."""
    seed: int = 1
    """Seed of the losses."""


def what_if(paths: Sequence[str], wanted: Wanted) -> WhatIf:
    """Run the load of recordings without and with changes.

    Raises:
        ConfigError: A file is wrong, or unsuitable.
    """
    facts = gather(paths)
    if not facts.tables:
        raise no_engine(", ".join(paths))
    measured = measure_channel(facts, seed=wanted.seed)
    scenario, notes = measured.scenario, list(measured.notes)
    if wanted.scenario is not None:
        written = read_json5(wanted.scenario)
        folder = Path(wanted.scenario).parent
        scenario = scenario_from_mapping(written, source=wanted.scenario, folder=folder)
        scenario = msgspec.structs.replace(scenario, seed=wanted.seed)
        notes = [f"the channel is that of {Path(wanted.scenario).name}"]
        lacking = {*facts.tables} - {node.address for node in scenario.nodes}
        if lacking:
            raise ConfigError(f"{wanted.scenario}: nodes: lacks {sorted(lacking)}")
    tables, rules = configured(facts, scenario, {})
    was = Change(scenario=scenario, modem=measured.modem, tables=tables, rules=rules)
    configs: Mapping[int, Config] = {}
    if wanted.config is not None:
        configs = configs_for(wanted.config, [node.address for node in scenario.nodes])
    tables, rules = configured(facts, scenario, configs)
    change = Change(
        scenario=with_loss(scenario, add=wanted.add_loss, instead=wanted.loss),
        modem=measured.modem,
        tables={node: _with_codec(table, wanted.codec) for node, table in tables.items()},
        rules={node: _with_access(each, wanted.access) for node, each in rules.items()},
    )
    found = compare(facts, was, change, measured.losses)
    found.notes = [*notes, *found.recorded.notes]
    return found


def _with_access(rules: TransmitRules, access: str | None) -> TransmitRules:
    return rules if access is None else msgspec.structs.replace(rules, access=ACCESS[access])


def _with_codec(table: StreamTable, codec: str | None) -> StreamTable:
    if codec is None:
        return table
    known = Table.of(table)
    streams = tuple(_spec_with(spec, codec) for spec in known.streams)
    return msgspec.structs.replace(known, streams=streams, model=None).table()


def _spec_with(spec: StreamSpec, codec: str) -> StreamSpec:
    """Return a spec with another codec; unchanged if that is not allowed."""
    if not isinstance(spec, TopicSpec) or spec.type_name is None:
        return spec
    changed = msgspec.structs.replace(spec, codec=codec)
    if codec != DENSE:
        return changed
    try:
        StreamTable([msgspec.structs.replace(changed, type_name=None)])
    except ConfigError:
        return spec
    return changed
