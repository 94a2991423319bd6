"""Two nodes with one address are named as what they are, wherever who hears whom."""

import random
from functools import partial

import pytest

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import AddressShared, Event, JournalDoubted
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.peers.doubt import Doubt
from zacoustic.core.peers.twins import Twins
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

LINK = LinkCapabilities(mtu_bytes=64, bit_rate_bps=20_000.0, propagation_s=0.05)
FRAME_NS = NS_PER_S // 20


class Sea:
    """Engines by name; each frame arrives after a twentieth of a second."""

    def __init__(
        self, addresses: dict[str, int], *, twins_hear: bool, link: LinkCapabilities
    ) -> None:
        self.now = 0
        self.twins_hear = twins_hear
        self.addresses = addresses
        self.due: list[tuple[int, int, str, Transmission]] = []
        self.events: dict[str, list[Event]] = {name: [] for name in addresses}
        self.engines = {}
        for number, (name, address) in enumerate(addresses.items()):
            table = StreamTable(
                [
                    TopicSpec(
                        stream_id=10, name="cmd", publishers=(1,), subscribers=(2,),
                        qos=Qos(reliability=Reliability.RELIABLE),
                    )
                ],
                nodes={1: "shore", 2: "auv1"},
            )  # fmt: skip
            engine = Engine(
                address=address, table=table, epoch=1000 + number, rng=random.Random(number)
            )
            engine.handle_link_state(LinkState.UP, 0, link)
            self.engines[name] = engine

    def run(self, until_s: float) -> None:
        while self.now < until_s * NS_PER_S:
            self.now += FRAME_NS
            for name, engine in self.engines.items():
                engine.handle_timeout(self.now)
                while (made := engine.poll_transmit(self.now)) is not None:
                    self.due.append((self.now + FRAME_NS, self.now, name, made))
                while (write := engine.poll_journal()) is not None:
                    engine.handle_journal_committed(write.write_id, self.now)
                while (event := engine.poll_event()) is not None:
                    self.events[name].append(event)
            due, self.due = self.due, []
            for item in due:
                if item[0] <= self.now:
                    self._arrive(*item[1:])
                else:
                    self.due.append(item)

    def _arrive(self, begun_at: int, name: str, made: Transmission) -> None:
        report = TransmitReport(
            transmission_id=made.transmission_id, outcome=TransmitOutcome.SENT,
            started_at=begun_at, finished_at=self.now,
        )  # fmt: skip
        self.engines[name].handle_transmit_report(report, self.now)
        source = self.addresses[name]
        for other, engine in self.engines.items():
            if other == name or (self.addresses[other] == source and not self.twins_hear):
                continue
            frame = ReceivedFrame(
                frame_bytes=made.frame_bytes, received_at=self.now, source=source,
                destination=made.destination,
            )  # fmt: skip
            engine.handle_frame(frame, self.now)

    def of(self, name: str, kind: type) -> list[Event]:
        return [each for each in self.events[name] if isinstance(each, kind)]


@pytest.mark.parametrize("twins_hear", [True, False])
@pytest.mark.parametrize("addressed", [True, False])
def test_two_nodes_with_one_address(addressed: bool, twins_hear: bool) -> None:
    link = LinkCapabilities(
        mtu_bytes=64, bit_rate_bps=20_000.0, propagation_s=0.05, addressed=addressed
    )
    sea = Sea({"a": 1, "b": 1, "c": 2}, twins_hear=twins_hear, link=link)
    for turn in range(8):
        for name in ("a", "b"):
            sea.engines[name].publish(10, b"%s%d" % (name.encode(), turn), sea.now)
            sea.run(sea.now / NS_PER_S + 15)
    assert sea.of("c", AddressShared)[0] == AddressShared(address=1)
    assert sea.engines["c"].twins.shared == {1}
    for name in ("a", "b"):
        if twins_hear:
            assert sea.of(name, AddressShared)[0] == AddressShared(address=1)
            assert not sea.engines[name].doubt.reason
        for each in sea.of(name, JournalDoubted):
            assert isinstance(each, JournalDoubted)
            assert "another node has its address" in each.reason


def test_one_that_restarts_ever_again_is_no_twin() -> None:
    told: list[object] = []
    doubt = Doubt(2, StreamTable([]), {}, JournalPort(), told.append)
    twins = Twins(2, doubt, told.append)
    for epoch in range(100):
        twins.heard_epoch(1, epoch, epoch)
    twins.heard_epoch(1, 98, 100)  # a late frame of the start before
    twins.sent(b"mine")
    for at in range(9):
        twins.heard_own(b"mine", at)  # an echo
    assert told == []
    assert twins.shared == frozenset()


def test_a_doubt_of_the_journal_itself_stays() -> None:
    told: list[object] = []
    make = partial(Doubt, 2, StreamTable([]), journal=JournalPort(), emit=told.append)
    damaged, accused = make(stored={"doubt": b"page 3 is damaged"}), make(stored={})
    accused.told("node 1 has later samples", 0)
    for each in (damaged, accused):
        each.explain()
        each.told("node 1 has later samples", 1)
    assert damaged.reason == "page 3 is damaged"
    assert accused.reason == ""
