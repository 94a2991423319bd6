"""Statistics: every byte on the link is in the ledger, once."""

import random

import pytest

from tests.core.rig import Rig, link
from zacoustic.core.base.qos import Priority, Qos, Stamp
from zacoustic.core.base.stats import Cause, EngineStats
from zacoustic.core.engine.events import RequestReceived
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable


def fleet(name: str = "a") -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name=name, qos=Qos(depth=20)),
            TopicSpec(stream_id=2, name="n", type_name="N", qos=Qos(depth=20, stamp=Stamp.AGE)),
            TopicSpec(stream_id=3, name="b", qos=Qos(priority=Priority.REAL_TIME)),
            ServiceSpec(stream_id=20, name="arm", server=2),
        ],
        types=TypeTable([TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint16"),))]),
        nodes={1: "shore", 2: "auv"},
    )


@pytest.mark.parametrize("mtu_bytes", [17, 32, 64, 512])
@pytest.mark.parametrize("seed", range(6))
def test_ledger_sums_exactly_to_the_bytes_given_to_the_link(seed: int, mtu_bytes: int) -> None:
    rng = random.Random(seed)
    lacks = {name: rng.random() < 0.5 for name in ("addressed", "checked", "framed")}
    capabilities = link(mtu_bytes=mtu_bytes, **lacks)
    rig = Rig({1: fleet(), 2: fleet(rng.choice("ab") + "x")}, capabilities=capabilities)
    for _ in range(60):
        address = rng.choice((1, 2))
        rig.publish(address, 1, rng.randbytes(rng.randrange(4)), delete=rng.random() < 0.1)
        rig.publish(address, 2, {"n": rng.randrange(1000)})
        if rng.random() < 0.3:
            rig.publish(address, 1, b"{}", encoding="application/json")
            rig.publish(address, 3, b"!")
            rig[1].engine.call(20, b"?", rig.now, timeout_s=1)
        for event in rig[2].got(RequestReceived)[-1:]:
            rig[2].engine.reply(event.call, b"ok", rig.now)
        rig.run(rng.uniform(0, 1), lambda source, node, transmission: rng.random() < 0.7)
    for address, end in rig.ends.items():
        stats = end.engine.stats
        sent = [each.frame_bytes for source, each in rig.frames if source == address]
        assert stats.frames_transmitted == len(sent)
        assert stats.bytes_transmitted == sum(map(len, sent))
        assert sum(entry.transmitted_bytes for entry in stats.ledger()) == sum(map(len, sent))
        assert stats.airtime_ns == sum(capabilities.airtime_ns(len(frame)) for frame in sent)
        assert all(entry.transmitted_bytes > 0 for entry in stats.ledger())


def test_ledger_is_sorted_and_holds_no_empty_lines() -> None:
    stats = EngineStats()
    stats.attribute(5, Cause.PAYLOAD, 3)
    stats.attribute(5, Cause.HEADER, 1)
    stats.attribute(0, Cause.HELLO, 0)
    stats.attribute(5, Cause.PAYLOAD, 4)
    lines = [(line.stream_id, line.cause, line.transmitted_bytes) for line in stats.ledger()]
    assert lines == [(5, Cause.HEADER, 1), (5, Cause.PAYLOAD, 7)]
