"""What an observer is told of the water, which no modem knows."""

import msgspec

from tests.links.evologics.emulator.sea import Sea
from zacoustic.channel.faults.blackout import BlackoutSpec
from zacoustic.channel.faults.faults import FaultSpec
from zacoustic_evologics.at.notifications import RecvIm
from zacoustic_evologics.emulator import Observation, SignalArrived, SignalEmitted, scenario_of


def test_who_speaks_into_what_is_coming_loses_it_and_the_observer_knows_why() -> None:
    told: list[Observation] = []
    sea = Sea(2, observer=told.append)
    near, far = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,64,2,noack," + b"x" * 64 + b"\n")
    sea.wait(0.5)
    far.say(b"AT*SENDIM,64,1,noack," + b"y" * 64 + b"\n")
    sea.run()
    emitted = [each for each in told if isinstance(each, SignalEmitted)]
    arrived = [each for each in told if isinstance(each, SignalArrived)]
    assert [(each.node, each.signal.content_bytes) for each in emitted] == [(1, 64), (2, 64)]
    outcomes = [(each.source, each.node, each.outcome.value) for each in arrived]
    assert outcomes == [(1, 2, "half_duplex"), (2, 1, "received")]


def test_emissions_of_a_modem_are_counted_and_each_arrival_names_its_own() -> None:
    told: list[Observation] = []
    sea = Sea(3, spacing_m=150.0, observer=told.append)
    host = sea.host(2)
    for _ in range(2):
        host.say(b"AT*SENDIM,1,255,noack,x\n")
        sea.run()
    numbers = [(type(each), each.sequence, each.node) for each in told if each.signal.source == 2]
    first = [(SignalArrived, 0, 1), (SignalArrived, 0, 3)]
    assert numbers[0] == (SignalEmitted, 0, 2)
    assert sorted(numbers[1:3], key=str) == first
    assert numbers[3] == (SignalEmitted, 1, 2)


def test_burst_is_seen_with_what_it_takes_to_connect() -> None:
    told: list[Observation] = []
    sea = Sea(2, observer=told.append)
    host = sea.host(1)
    host.say(b"AT*SEND,100,2," + b"x" * 100 + b"\n")
    sea.run()
    sent = [
        (each.signal.kind.service, each.signal.content_bytes)
        for each in told
        if isinstance(each, SignalEmitted)
    ]
    assert sent == [("connect", 0), ("accept", 0), ("burst", 100), ("burst ack", 0)]


def test_faults_of_the_scenario_happen() -> None:
    said = b"AT*SENDIM,4,2,noack,abcd\n"
    usual_s, heard_s = 0.0, []
    for faults in (
        FaultSpec(),
        FaultSpec(blackouts=(BlackoutSpec(node=2, from_s=0.0, to_s=100.0),)),
        FaultSpec(jitter_s=5.0),
        FaultSpec(duplicate=1.0, duplicate_after_s=2.0),
        FaultSpec(corrupt=1.0),
    ):
        sea = Sea(msgspec.structs.replace(scenario_of(2, spacing_m=1500.0), faults=faults))
        near, far = sea.host(1), sea.host(2)
        near.say(said)
        sea.run()
        at_s = [round(at, 6) for at, message in far.heard if isinstance(message, RecvIm)]
        payloads = [message.payload for message in far.all_of(RecvIm)]
        usual_s = usual_s or at_s[0]
        heard_s.append(at_s)
        assert (payloads in ([], [b"abcd"], [b"abcd"] * 2)) is not bool(faults.corrupt)
    usual, dark, late, twice, damaged = heard_s
    assert usual == damaged == [usual_s]
    assert dark == []
    assert usual_s < late[0] < usual_s + 5.0
    assert twice == [usual_s, round(usual_s + 2.0, 6)]
