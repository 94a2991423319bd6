"""Outstanding transmissions: each part of a frame learns once what became of it, and by the id.

A link may be replaced while a frame is under way, by a modem that takes frames of another size:
then nobody ever reports of that frame to whoever waits for its end, or much too late.
"""

import random

import pytest

from tests.core.rig import End, Pass, Rig, link
from zacoustic.core.base.parts import Part
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryEnded,
    DeliveryOutcome,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import (
    LinkMetrics,
    LinkState,
    PeerMeasured,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable

LOG, ASK = 1, 20
MODEM = {"bit_rate_bps": 2000, "propagation_s": 0.1, "acknowledges": True, "measures_range": True}
ONE, OTHER = (link(mtu_bytes=size, **MODEM) for size in (64, 60))
PHOTO = random.Random("photo").randbytes(400)


def fleet() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(
                stream_id=LOG,
                name="log",
                qos=Qos(reliability=Reliability.RELIABLE, depth=8),
                publishers=(1,),
            ),
            ServiceSpec(stream_id=ASK, name="ask", server=2),
        ],
        nodes={1: "shore", 2: "auv"},
    )


class Changing(Rig):
    """Two nodes whose links are replaced now and then while a frame is under way."""

    def __init__(self, seed: int, share: float) -> None:
        super().__init__({1: fleet(), 2: fleet()}, capabilities=ONE)
        self._rng = random.Random(seed)
        self._share = share
        self.replaced = 0

    def exchange(self, passes: Pass = lambda source, node, transmission: True) -> list[bytes]:
        crossed: list[bytes] = []
        for _ in range(1000):
            found = [(end, end.poll(self.now)) for end in self.ends.values()]
            for end, sent in found:
                if sent is None:
                    continue
                crossed.append(sent.frame_bytes)
                is_replaced = self._rng.random() < self._share
                if is_replaced:
                    self.replace(end)
                if not is_replaced or self._rng.random() < 0.5:
                    self.deliver(end.address, sent, passes)
                end.report(sent)  # of a link that was replaced it is nobody's
                self.answer(self.ends[2])
            if not any(sent for _, sent in found):
                return crossed
        raise AssertionError("the engines do not come to rest")

    def replace(self, end: End) -> None:
        self.replaced += 1
        end.capabilities = OTHER if end.capabilities == ONE else ONE
        end.engine.handle_link_state(LinkState.UP, self.now, end.capabilities)
        end.settle()

    def answer(self, server: End) -> None:
        for event in server.got(RequestReceived):
            server.events.remove(event)
            server.engine.reply(event.call, b"yes", self.now)
            server.settle()


@pytest.mark.parametrize("seed", range(6))
def test_nothing_waits_for_the_report_of_a_link_that_was_replaced(seed: int) -> None:
    rig = Changing(seed, 0.3)
    one = rig[1]
    for value in (b"small", PHOTO, b"last"):
        one.engine.publish(LOG, value, rig.now)
    one.engine.call(ASK, b"?", rig.now, timeout_s=3000.0)
    one.engine.ranging.request(2, rig.now, timeout_s=3000.0)
    one.settle()
    rig.run(1500)
    found = LinkMetrics(propagation_s=0.1)
    measured = PeerMeasured(address=2, measured_at=rig.now, metrics=found)
    one.engine.handle_measurement(measured, rig.now)
    rig.run(300)
    assert rig.replaced > 2
    assert (
        one.engine.stats.dropped["stray_report"]
        + rig[2].engine.stats.dropped.get("stray_report", 0)
        == rig.replaced
    )
    assert [each.value for each in rig[2].got(SampleReceived)] == [b"small", PHOTO, b"last"]
    assert [each.outcome for each in one.got(DeliveryEnded)] == [DeliveryOutcome.DELIVERED] * 3
    assert [each.value for each in one.got(ResponseReceived)] == [b"yes"]
    assert len(one.got(RangeMeasured)) == 1
    assert not one.got(CallFailed)
    assert not one.got(RangeFailed)


def test_report_that_comes_twice_or_of_nothing_moves_nothing() -> None:
    one = End(1, fleet(), capabilities=ONE)
    one.engine.publish(LOG, b"x", 0)
    sent = one.poll(0)
    assert sent is not None
    unknown = TransmitReport(
        transmission_id=sent.transmission_id + 1, outcome=TransmitOutcome.SENT,
        started_at=0, finished_at=0,
    )  # fmt: skip
    one.engine.handle_transmit_report(unknown, 0)
    assert one.poll(seconds_to_ns(100)) is None  # the one before is still under way
    one.report(sent)
    repeated_at = one.engine.poll_timeout()
    one.report(sent, TransmitOutcome.REJECTED)
    assert one.engine.poll_timeout() == repeated_at
    assert one.engine.stats.dropped == {"stray_report": 2}
    assert one.engine.stats.reports == {"sent": 1}


class Told:
    """What the parts of some frames were told."""

    def __init__(self) -> None:
        self.told: list[tuple[str, str | int]] = []

    def part(self, name: str) -> Part:
        return Part(
            transmitted=lambda now: self.told.append((name, now)),
            reported=lambda report, now: self.told.append((name, report.outcome.value)),
        )


def report(transmission_id: int, outcome: TransmitOutcome) -> TransmitReport:
    return TransmitReport(
        transmission_id=transmission_id, outcome=outcome, started_at=5, finished_at=6
    )


def test_port_tells_the_parts_of_that_transmission_only_and_once() -> None:
    port, all_told = LinkPort(ONE, 1, random.Random(1)), Told()
    port.transmit(7, (all_told.part("a"), all_told.part("b")), 5)
    port.transmit(8, (all_told.part("c"),), 5)
    assert all_told.told == [("a", 5), ("b", 5), ("c", 5)]
    all_told.told.clear()
    assert port.finish(report(8, TransmitOutcome.DELIVERED), 6)
    assert not port.finish(report(8, TransmitOutcome.REJECTED), 6)
    assert not port.finish(report(9, TransmitOutcome.SENT), 6)
    assert all_told.told == [("c", "delivered")]
    assert port.is_busy
    port.close(7)
    assert all_told.told == [("c", "delivered"), ("a", "aborted"), ("b", "aborted")]
    assert not port.is_busy
    assert not port.finish(report(7, TransmitOutcome.SENT), 8)
    assert len(all_told.told) == 3
