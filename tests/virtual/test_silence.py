"""An idle system transmits nothing, and a sample costs one byte beside its payload."""

from functools import partial

import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

DAY_S = 24 * 3600.0


def fleet(nodes: int, name: str = "nav") -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=10, name=name, qos=Qos(depth=5)),
            TopicSpec(stream_id=11, name="agreed", qos=Qos(depth=5)),
        ],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


def network(
    nodes: int, tables: dict[int, StreamTable] | None = None, modem: Modem | None = None
) -> tuple[VirtualNetwork, list[TraceRecord]]:
    """Return nodes at 300 m from each other, and the frames that they send."""
    sent: list[TraceRecord] = []

    def trace(record: TraceRecord) -> None:
        if record.what == "transmit":
            sent.append(record)

    medium = line(*(300.0 * number for number in range(nodes)), channel="none", seed=5)
    return VirtualNetwork(medium, tables or fleet(nodes), trace=trace, modem=modem), sent


@pytest.mark.parametrize("nodes", [2, 5])
@pytest.mark.parametrize("modem", [Modem(), Modem(addressed=False, checked=False, framed=False)])
def test_idle_nodes_send_no_frame_in_a_day(nodes: int, modem: Modem) -> None:
    medium, sent = network(nodes, modem=modem)
    assert medium.is_quiet
    medium.run(until_s=DAY_S)
    assert sent == []
    assert medium.is_quiet
    for address in medium.addresses:
        assert medium.engine(address).is_idle
        assert medium.engine(address).poll_timeout() is None


@pytest.mark.parametrize("nodes", [2, 5])
@pytest.mark.parametrize("differing", [False, True])
def test_nodes_fall_silent_when_their_traffic_has_ended(nodes: int, differing: bool) -> None:
    tables = {
        address: fleet(nodes, "other" if differing and address == 2 else "nav")
        for address in range(1, nodes + 1)
    }
    medium, sent = network(nodes, tables)
    for step in range(20):
        for address in range(1, nodes + 1):
            for stream_id in (10, 11):
                medium.at(
                    step * 20 + address * 3 + stream_id,
                    partial(medium.publish, address, stream_id, b"x"),
                )
    medium.run(until_s=DAY_S)
    control_only = [record for record in sent if not record.streams]
    assert len(control_only) <= 12 * nodes * (nodes - 1) * (1 + differing)
    assert max(record.at for record in sent) < 3600 * 10**9
    assert medium.is_quiet
    assert all(medium.engine(address).is_idle for address in medium.addresses)


@pytest.mark.parametrize("differing", [False, True])
def test_handshake_goes_quiet_under_lasting_traffic(differing: bool) -> None:
    tables = {1: fleet(2), 2: fleet(2, "other" if differing else "nav")}
    medium, sent = network(2, tables)
    medium.every(30, lambda: medium.publish(1, 11, b"x"))
    medium.run(until_s=6 * 3600)
    control_only = [record for record in sent if not record.streams]
    assert len(control_only) <= 12
    assert all(record.at < 3600 * 10**9 for record in control_only)
    assert len(medium.samples(2, 11)) >= 715


def test_one_way_traffic_is_confirmed_once_and_then_costs_one_byte() -> None:
    medium, sent = network(2)
    medium.every(10, lambda: medium.publish(1, 11, b"payload"), first_s=10)
    medium.run(until_s=DAY_S / 4 + 5)
    answers = [record for record in sent if record.node == 2]
    assert [record.frame for record in answers] == ["b5010001"]
    samples = [bytes.fromhex(record.frame) for record in sent if record.node == 1]
    assert samples[2:] == [b"\x0bpayload"] * (len(samples) - 2)
    assert len(medium.samples(2)) == len(samples) == 2160
    ledger = {
        (entry.stream_id, entry.cause): entry.transmitted_bytes
        for entry in medium.engine(1).stats.ledger()
    }
    assert ledger[11, Cause.HEADER] == len(samples)
    assert ledger[11, Cause.PAYLOAD] == len(samples) * len(b"payload")
    assert ledger[0, Cause.HELLO] <= 16


def test_five_nodes_all_reach_one_byte_a_sample() -> None:
    medium, sent = network(5)
    for address in range(1, 6):
        medium.every(50, partial(medium.publish, address, 11, b"x"), first_s=7 * address)
    medium.run(until_s=3600)
    late = [record for record in sent if record.at > 3000 * 10**9]
    assert len(late) >= 60
    assert {record.frame for record in late} == {"0b78"}
    assert {record.peer for record in late} == {BROADCAST}
