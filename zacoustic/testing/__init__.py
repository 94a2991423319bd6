"""Tools to test links and applications, shipped so that third parties can use them.

`virtual` runs many real engines on the simulated channel in virtual time, with crashes; `scenarios`
has random scenarios and their invariants; `conformance` is the battery that every link passes. The
other names here are what a `VirtualNetwork` is made of: nodes and channel, streams, rules.
"""

from zacoustic.channel.scenario import NodeSpec, Scenario, scenario_from_mapping
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost
from zacoustic.core.engine.engine import Engine
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import TypeTable, type_from_struct
from zacoustic.testing.smallsizes import SMALL_SIZES
from zacoustic.testing.virtual import Modem, VirtualNetwork

__all__ = [
    "SMALL_SIZES",
    "ActionSpec",
    "Bond",
    "BondLink",
    "Carry",
    "ContactRules",
    "Engine",
    "LinkCost",
    "LinkRules",
    "Modem",
    "NodeSpec",
    "Route",
    "Scenario",
    "ServiceSpec",
    "StreamTable",
    "TopicSpec",
    "TransmitRules",
    "TypeTable",
    "VirtualNetwork",
    "scenario_from_mapping",
    "type_from_struct",
]
