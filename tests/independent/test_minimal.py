"""Two and three minimal nodes on a channel that loses, delays and repeats frames."""

import heapq
import random
from dataclasses import dataclass, field

import pytest

from tests.independent import calls, describe, envelope, fleet, objects
from tests.independent.minimal import Answered, Delivered, Link, Node, NotRead, Requested
from tests.independent.record import Payload
from tests.independent.table import Service, Stream, Table, Topic

UNIT_S = 1.0
LINK = Link(mtu=64, unit_s=UNIT_S, linger_s=0.1, turn_s=0.2)
DIGEST = describe.table_digest(fleet.TABLE)


@dataclass
class Channel:
    """A virtual channel."""

    nodes: dict[int, Node]
    chance: random.Random
    loss: float = 0.0
    repeats: float = 0.0
    now: float = 0.0
    sent: list[tuple[float, int, bytes]] = field(default_factory=list)
    _arriving: list[tuple[float, int, int, bytes]] = field(default_factory=list)
    _free_s: dict[int, float] = field(default_factory=dict)

    def run(self, until: float) -> None:
        while True:
            times = [self._arriving[0][0]] if self._arriving else []
            for address, node in self.nodes.items():
                due = node.next_due()
                if due is not None:
                    times.append(max(due, self.now, self._free_s.get(address, 0.0)))
            if not times or min(times) > until:
                self.now = until
                return
            self.now = max(self.now, min(times))
            self._arrive()
            for address, node in self.nodes.items():
                if self.now >= self._free_s.get(address, 0.0):
                    data = node.poll(self.now)
                    # One that has nothing at a time that it named is asked again a bit later.
                    self._free_s[address] = self.now + (0.05 if data is None else 0.6)
                    if data is not None:
                        self._transmit(address, data)

    def _transmit(self, address: int, data: bytes) -> None:
        assert len(data) <= LINK.mtu
        self.sent.append((self.now, address, data))
        for other in self.nodes:
            if other == address:
                continue
            for _ in range(1 + (self.chance.random() < self.repeats)):
                if self.chance.random() >= self.loss:
                    delay = self.chance.uniform(0.6, UNIT_S)
                    heapq.heappush(self._arriving, (self.now + delay, len(self.sent), other, data))

    def _arrive(self) -> None:
        while self._arriving and self._arriving[0][0] <= self.now:
            _, _, other, data = heapq.heappop(self._arriving)
            self.nodes[other].handle(data, self.now)


def _node(address: int, epoch: int, table: Table = fleet.TABLE) -> Node:
    chance = random.Random(100 * address + epoch)
    return Node(address, table, epoch, LINK, chance, 0.0)


def _with(stream: Stream) -> Table:
    return Table({**fleet.TABLE.streams, stream.id: stream}, fleet.TABLE.types, fleet.NODES)


def _channel(seed: int = 0, loss: float = 0.0, repeats: float = 0.0) -> Channel:
    nodes = {1: _node(1, 0x1234), 2: _node(2, 0x5678)}
    return Channel(nodes, random.Random(seed), loss, repeats)


def _payloads(node: Node, stream: int) -> list[Payload | None]:
    return [
        one.sample.payload
        for one in node.events
        if isinstance(one, Delivered) and one.sample.stream == stream
    ]


def test_the_first_frame_is_as_the_vector_says() -> None:
    node = _node(2, 1, fleet.BASE)
    node.publish(10, fleet.NAV_VALUE, 0.0)
    node.publish(11, b"raw", 0.0)
    opened = node.poll_opened(0.0)
    assert opened is not None
    vector = "b0020001200b2be1b20c0a1a02b4bfc0187b190a9b010b726177"
    assert (opened.destination, opened.records.hex()) == (255, vector)
    node.publish(11, b"raw", 1.0)
    opened = node.poll_opened(1.0)
    assert opened is not None
    assert opened.records.hex() == "b100010b726177"


def test_best_effort_and_agreement() -> None:
    channel = _channel()
    two, one = channel.nodes[2], channel.nodes[1]
    for count in range(30):
        two.publish(11, bytes((count + 1,)), channel.now)
        one.publish(21, bytes((count + 1,)), channel.now)
        channel.run(channel.now + 10)
    assert _payloads(one, 11) == [bytes((count + 1,)) for count in range(30)]
    assert _payloads(two, 21) == [bytes((count + 1,)) for count in range(30)]
    last = [data for _, address, data in channel.sent if address == 2][-1]
    assert last[2 : -0 or None] == b"\x0b\x1e"
    assert not [one for one in one.events if isinstance(one, NotRead)]


def test_two_nodes_with_nothing_to_send_are_silent() -> None:
    channel = _channel()
    channel.run(1e6)
    assert not channel.sent
    channel.nodes[2].publish(11, b"x", channel.now)
    channel.run(channel.now + 1e6)
    count = len(channel.sent)
    channel.run(channel.now + 1e6)
    assert len(channel.sent) == count < 12


@pytest.mark.parametrize("seed", range(12))
def test_reliable_samples_come_in_order_and_once(seed: int) -> None:
    channel = _channel(seed, loss=0.3, repeats=0.2)
    one, two = channel.nodes[1], channel.nodes[2]
    wanted = [f"order {count}".encode() for count in range(40)]
    for order in wanted:
        one.publish(30, order, channel.now)
        two.publish(31, b"log", channel.now, ("sonar",))
        channel.run(channel.now + channel.chance.uniform(30, 400))
    channel.run(channel.now + 2000)
    assert _payloads(two, 30) == wanted
    assert _payloads(one, 31) == [b"log"] * 40


@pytest.mark.parametrize("seed", range(6))
def test_what_depth_passes_over_is_not_awaited(seed: int) -> None:
    channel = _channel(seed, loss=0.5)
    one, two = channel.nodes[1], channel.nodes[2]
    wanted = [bytes((count + 1,)) for count in range(100)]
    for order in wanted:
        one.publish(30, order, channel.now)
        channel.run(channel.now + 3)
    channel.run(channel.now + 3000)
    got = _payloads(two, 30)
    assert got == [order for order in wanted if order in got]
    assert got[-8:] == wanted[-8:]


@pytest.mark.parametrize("seed", range(6))
def test_a_publisher_that_restarts(seed: int) -> None:
    channel = _channel(seed, loss=0.2)
    channel.nodes[1].publish(30, b"before", channel.now)
    channel.run(200)
    channel.nodes[1] = _node(1, 0x4321)
    channel.nodes[1].publish(30, b"after", channel.now)
    channel.run(600)
    assert _payloads(channel.nodes[2], 30) == [b"before", b"after"]


@pytest.mark.parametrize("seed", range(6))
def test_a_receiver_that_restarts(seed: int) -> None:
    channel = _channel(seed, loss=0.2)
    for order in (b"1", b"2", b"3"):
        channel.nodes[1].publish(30, order, channel.now)
        channel.run(channel.now + 100)
    channel.nodes[2] = _node(2, 0x8765)
    channel.nodes[1].publish(30, b"4", channel.now)
    channel.run(channel.now + 1000)
    assert _payloads(channel.nodes[2], 30) == [b"4"]


@pytest.mark.parametrize("seed", range(12))
def test_calls_are_executed_once(seed: int) -> None:
    channel = _channel(seed, loss=0.3, repeats=0.2)
    one, two = channel.nodes[1], channel.nodes[2]
    executed: list[Payload] = []

    def arm(request: Payload) -> Payload:
        executed.append(request)
        if request == b"\x05":
            raise RuntimeError("no arm")
        return b"ok"

    two.handlers[20] = arm
    for count in range(90):
        one.call(20, bytes((count,)), channel.now)
        channel.run(channel.now + channel.chance.choice((1, 40)))
    channel.run(channel.now + 100)
    answers = {event.index: event.result for event in one.events if isinstance(event, Answered)}
    assert sorted(answers) == list(range(90))
    assert len(executed) == len({str(request) for request in executed})
    good = [index for index, answer in answers.items() if answer == b"ok"]
    assert len(good) > 60
    assert all(bytes((index,)) in executed for index in good)
    assert answers[5] in (calls.Failure(1, "no arm"), calls.Failure(6, ""))


def test_the_status_of_a_node_by_a_call() -> None:
    channel = _channel()
    status = {
        "journal": "none",
        "starts": 0,
        "utc_s": None,
        "clock_error_s": None,
        "range_m": None,
        "schedule": 0,
    }
    channel.nodes[2].handlers[0xAE] = lambda _: status
    channel.nodes[1].call(0xAE, b"", 0.0, server=2)
    channel.run(30)
    assert channel.nodes[1].events == [Answered(0xAE, 0, status)]


def test_an_answer_that_takes_its_time() -> None:
    channel = _channel(4, loss=0.3)
    one, two = channel.nodes[1], channel.nodes[2]
    two.handlers[20] = lambda _: None
    one.call(20, b"\x01", 0.0)
    channel.run(18)
    (request,) = [event for event in two.events if isinstance(event, Requested)]
    assert not one.events
    two.respond(request, b"late", channel.now)
    channel.run(40)
    assert [event for event in one.events if isinstance(event, Answered)] == [
        Answered(20, 0, b"late")
    ]


def test_a_request_that_does_not_decode() -> None:
    table = _with(Service(20, "auv1/arm", 2, request="Nav"))
    channel = _channel()
    channel.nodes = {1: _node(1, 1, table), 2: _node(2, 9, table)}
    channel.nodes[1].call(20, b"\x01", 0.0)
    channel.run(30)
    assert channel.nodes[1].events == [Answered(20, 0, calls.Failure(3, ""))]


def test_a_request_of_a_stream_that_differs() -> None:
    channel = _channel()
    channel.nodes[2] = _node(2, 9, _with(Service(20, "auv1/arm", 2, timeout_s=20)))
    channel.nodes[1].call(20, b"\x01", 0.0)
    channel.run(60)
    answers = [one for one in channel.nodes[1].events if isinstance(one, Answered)]
    assert answers == [Answered(20, 0, calls.Failure(4, ""))]


def test_a_service_that_nobody_serves() -> None:
    channel = _channel()
    channel.nodes[1].call(20, b"\x01", 0.0)
    channel.run(30)
    assert channel.nodes[1].events == [Answered(20, 0, calls.Failure(2, ""))]


def test_tables_that_differ_in_one_stream() -> None:
    one = _node(1, 1)
    two = _node(2, 2, _with(Topic(11, "auv1/raw", aged=True)))
    channel = Channel({1: one, 2: two}, random.Random(0))
    for _ in range(20):
        two.publish(11, b"aged", channel.now)
        two.publish(13, b"same", channel.now, ("ctd",))
        channel.run(channel.now + 50)
    assert not _payloads(one, 11)
    assert len(_payloads(one, 13)) > 12
    count = len(channel.sent)
    channel.run(channel.now + 1e6)
    assert len(channel.sent) < count + 5


def test_three_nodes() -> None:
    nodes = {1: "shore", 2: "auv1", 3: "auv2"}
    log = Topic(31, "fleet/{node}/log", reliable=True, depth=8)
    arm = Service(20, "auv1/arm", server=2, timeout_s=30)
    table = Table({31: log, 20: arm, 11: Topic(11, "raw")}, {}, nodes)
    all_nodes = {node: _node(node, 7 + node, table) for node in nodes}
    channel = Channel(all_nodes, random.Random(3), loss=0.2)
    wanted = [bytes((count + 1,)) for count in range(20)]
    for line in wanted:
        for node in all_nodes.values():
            node.publish(31, line, channel.now)
        channel.run(channel.now + 150)
    channel.run(channel.now + 1000)
    for node in all_nodes.values():
        for source in nodes:
            got = [
                event.sample.payload
                for event in node.events
                if isinstance(event, Delivered) and event.source == source
            ]
            assert got == ([] if source == node.address else wanted)


def test_random_frames_do_no_harm() -> None:
    chance = random.Random(5)
    node = _node(1, 1)
    node.publish(30, b"x", 0.0)
    for count in range(1500):
        source = chance.choice((2, 3, 9))
        data = bytes((chance.choice((1, 255)), source)) + chance.randbytes(chance.randrange(30))
        node.handle(data, float(count))
        node.poll(float(count))


def _from_two(records: str) -> bytes:
    link = LINK.capabilities
    return envelope.wrap(envelope.Opened(2, 1, bytes.fromhex(records)), link)


HELLO_OF_TWO = f"b0025678{DIGEST.hex()}"


def _answers(node: Node) -> list[Answered]:
    return [event for event in node.events if isinstance(event, Answered)]


def test_an_unnamed_answer_is_taken_only_of_a_server_that_has_confirmed_the_epoch() -> None:
    node = _node(1, 1)
    node.call(20, b"\x01", 0.0)
    assert node.poll(0.0) is not None
    node.handle(_from_two(HELLO_OF_TWO + "14406f6b"), 1.0)
    assert not _answers(node)
    opened = node.poll_opened(1.0)
    assert opened is not None
    assert opened.records.startswith(bytes.fromhex("b0020001") + DIGEST)
    assert opened.records.endswith(bytes.fromhex("140001"))
    node.handle(_from_two(HELLO_OF_TWO + "b501000214406f6b"), 2.0)
    assert not _answers(node)
    node.handle(_from_two(HELLO_OF_TWO + "b501000114406f6b"), 3.0)
    assert _answers(node) == [Answered(20, 0, b"ok")]


def test_a_named_answer_of_another_epoch_is_not_taken() -> None:
    node = _node(1, 1)
    node.call(20, b"\x01", 0.0)
    assert node.poll(0.0) is not None
    node.handle(_from_two(HELLO_OF_TWO + "1400426f6b"), 1.0)
    assert not _answers(node)
    node.handle(_from_two(HELLO_OF_TWO + "1400416f6b"), 2.0)
    assert _answers(node) == [Answered(20, 0, b"ok")]
    opened = node.poll_opened(2.0)
    assert opened is not None
    assert opened.records.endswith(bytes.fromhex("14c0"))


def test_a_record_without_introduction_waits_for_the_settling_time() -> None:
    node = _node(1, 1)
    node.handle(_from_two(HELLO_OF_TWO + "0b61"), 0.0)
    node.handle(_from_two("0b62"), 3.9)
    assert _payloads(node, 11) == [b"a"]
    node.handle(_from_two("0b63"), 4.0)
    node.handle(_from_two("b156780b64"), 4.0)
    node.handle(_from_two("b156790b65"), 4.0)
    node.handle(_from_two("0b66"), 9.0)
    assert _payloads(node, 11) == [b"a", b"c", b"d"]


def test_an_object_is_refused() -> None:
    node = _node(2, 1)
    whole = objects.make_object(30, 0x1234, 7, b"", None, bytes(60))
    parts = objects.cut(whole, 40)
    out: list[str] = []
    for index, part in enumerate(parts):
        hint = 0 if index == len(parts) - 1 else 1
        fragment = objects.Fragment(5, hint, index, part)
        data = envelope.wrap(envelope.Opened(1, 2, fragment.write()), LINK.capabilities)
        node.handle(data, float(index))
        opened = node.poll_opened(float(index))
        out += [] if opened is None else [opened.records.hex()]
    assert len(parts) == 2
    assert out[-1].endswith("bb8502")
    assert sum("bb8502" in records for records in out) == 1
