"""Lost contact in virtual time: what is contact with a seal, and vehicles that are let down."""

from typing import Any

import pytest

from tests.virtual.fleet import line
from tests.virtual.sealed import SealedFleet
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import ContactLost, ContactRestored, SampleReceived
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.peers.lostcontact import LostContactRule
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

AFTER_S = 300.0
NAV = 10


def table(nodes: int = 2) -> StreamTable:
    named = {address: f"n{address}" for address in range(1, nodes + 1)}
    return StreamTable([TopicSpec(stream_id=NAV, name="nav")], nodes=named)


def rules(*nodes: int, heartbeat_s: float | None = None, **settings: Any) -> TransmitRules:
    rule = LostContactRule(name="surface", nodes=nodes, lost_after_s=AFTER_S)
    contact = ContactRules(lost_contact=(rule,), heartbeat_s=heartbeat_s)
    return TransmitRules(contact=contact, **settings)


def events(network: VirtualNetwork, node: int) -> list[str]:
    kinds = (ContactLost, ContactRestored)
    found = (event for at, event in network.events if at == node)
    return [type(event).__name__ for event in found if isinstance(event, kinds)]


@pytest.mark.parametrize("is_forged", [False, True])
def test_only_an_authentic_frame_is_contact_where_frames_are_sealed(is_forged: bool) -> None:
    """Without the key of the fleet, node 1 can send what `emergency` allows, and is no contact."""
    fleet = SealedFleet()

    def build(*, address: int, **settings: Any) -> Engine:
        make = Engine if is_forged and address == 1 else fleet
        return make(address=address, **settings)

    allowed = SealRules(unsealed=frozenset({NAV}))
    network = VirtualNetwork(
        line(0, 800, channel="none"),
        table(),
        modem=Modem(),
        build=build,
        rules={1: TransmitRules(), 2: rules(1, sealing=allowed)},
    )
    network.every(50.0, lambda: network.publish(1, NAV, b"stop"))
    network.run(until_s=3600.0)
    assert [at for at, event in network.events if at == 2 and isinstance(event, SampleReceived)]
    assert events(network, 2) == (["ContactLost"] if is_forged else [])


def test_unsealed_frame_in_the_name_of_the_node_arms_it_again() -> None:
    network = VirtualNetwork(
        line(0, 800, channel="none"), table(), rules={1: TransmitRules(), 2: rules(1)}
    )
    network.at(AFTER_S + 10, lambda: network.publish(1, NAV, b"anybody can send this"))
    network.run(until_s=AFTER_S + 60)
    assert events(network, 2) == ["ContactLost", "ContactRestored"]


def test_crew_that_beats_keeps_the_vehicle_at_work_until_all_of_it_is_gone() -> None:
    network = VirtualNetwork(
        line(0, 400, 900, channel="none"), table(3), rules=rules(1, 2, heartbeat_s=60.0)
    )
    network.at(1000, lambda: network.crash(1))
    network.at(5000, lambda: network.crash(2))
    network.run(until_s=5000.0)
    assert events(network, 3) == []
    network.run(until_s=5000.0 + AFTER_S + 1)
    assert events(network, 3) == ["ContactLost"]
    network.at(9000, lambda: network.start(1))
    network.run(until_s=9000.0 + 100)
    assert events(network, 3) == ["ContactLost", "ContactRestored"]


@pytest.mark.parametrize("reboots", [False, True])
@pytest.mark.parametrize("up_s", [5, 100])
def test_vehicle_that_crashes_all_the_time_acts_in_the_end(up_s: int, reboots: bool) -> None:
    network = VirtualNetwork(
        line(0, 800, channel="none"), table(), rules={1: TransmitRules(), 2: rules(1)}
    )
    until_s = 0
    while "ContactLost" not in events(network, 2):
        until_s += up_s
        network.run(until_s=until_s)
        if "ContactLost" not in events(network, 2):
            network.crash(2, reboots=reboots)
            network.start(2)
        assert until_s <= AFTER_S, "it never acts"
    assert reboots or until_s >= AFTER_S
