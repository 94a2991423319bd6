"""Local samples wait for their frame in a ring, and only those that may be superseded."""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from zacoustic.core.base.qos import Durability, Priority, Qos, Reliability
from zacoustic.core.schedule.transmitter import Opening
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.zenoh.gateway.dialect.ringbox import LOOK_NS
from zacoustic.zenoh.gateway.streams.intake import HELD_NS, Intake

S = 1_000_000_000
MARK = b"from the channel"


class Payload(bytes):
    def to_bytes(self) -> bytes:
        return bytes(self)


class Sample:
    key_expr, encoding, kind = "a", "zenoh/bytes", zenoh.SampleKind.PUT

    def __init__(self, payload: bytes, attachment: bytes | None = None) -> None:
        self.payload = Payload(payload)
        self.attachment = None if attachment is None else Payload(attachment)


class Subscriber:
    """A subscriber as Zenoh makes it: a callback, or a ring."""

    def __init__(self, handler: Any, declared: list["Subscriber"]) -> None:
        self.call: Callable[[Any], None] | None = handler if callable(handler) else None
        self._ring: deque[Any] = deque(maxlen=8)
        self._declared = declared
        declared.append(self)

    def put(self, sample: Any) -> None:
        self._ring.append(sample) if self.call is None else self.call(sample)

    def try_recv(self) -> Any:
        return self._ring.popleft() if self._ring else None

    def undeclare(self) -> None:
        self._declared.remove(self)


class Network:
    """A session, its dialect and an engine, as far as an intake knows them."""

    capabilities = None

    def __init__(self, qos: Qos) -> None:
        self.now = S
        self.declared: list[Subscriber] = []
        self.opening = Opening.FREE
        self.waits = 0
        self.rung = 0
        self.told = 0
        """How often the engine was told that samples wait here."""
        self.is_latched = qos.durability is Durability.TRANSIENT_LOCAL
        self.stream = StreamTable([TopicSpec(stream_id=1, name="a", qos=qos)]).by_id(1)
        self.session = self.zenoh_session = self
        self.intake = Intake(
            {1: self},  # type: ignore[dict-item]
            lambda stream, engine: 0,
            clock=lambda: self.now,
            ring=self._ring,
            submit=self._submit,
        )
        self.intake.subscribe(1, "a")

    def declare_subscriber(self, key: object, handler: Any, **_: object) -> Subscriber:
        return Subscriber(handler, self.declared)

    def callback(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        return take

    def subscribe(self, expression: str, take: Callable[[Any], None]) -> list[Subscriber]:
        return [Subscriber(take, self.declared)]

    def is_marked(self, attachment: bytes) -> bool:
        return attachment == MARK

    def age_ns(self, sample: object) -> int:
        return 0

    def publisher_of(self, sample: object) -> bytes:
        return b""

    def link_of(self, stream_id: int) -> str:
        return "link"

    def pending(self, stream_id: int) -> int:
        return self.waits

    def openings(self, link: str, now: int) -> Opening:
        return self.opening

    def handle_waiting(self, link: str, now: int) -> None:
        assert self.opening is Opening.CLOSED
        self.told += 1

    def put(self, *payloads: bytes, attachment: bytes | None = None) -> None:
        for payload in payloads:
            for each in list(self.declared):
                each.put(Sample(payload, attachment))

    def due(self) -> list[tuple[bytes, int]]:
        """Let the loop look; returns payloads with their arrivals."""

        async def looked() -> list[tuple[bytes, int]]:
            engine = Engine(self)
            found = list(self.intake.due(engine, self.now))  # type: ignore[arg-type]
            self.intake.close()
            return [(each.payload, each.arrived_at) for _, parcels in found for each in parcels]

        return asyncio.run(looked())

    @property
    def wakes(self) -> bool:
        """Whether a sample wakes the loop."""
        return any(each.call is not None for each in self.declared)

    def _submit(self, step: Callable[[], object]) -> None:
        step()

    def _ring(self) -> None:
        self.rung += 1


class Engine:
    """The engine's answers, which a network has."""

    capabilities = None

    def __init__(self, network: Network) -> None:
        self.link_of, self.pending = network.link_of, network.pending
        self.opening, self.handle_waiting = network.openings, network.handle_waiting


def test_sample_wakes_an_idle_gateway_and_is_taken_at_once() -> None:
    network = Network(Qos())
    network.put(b"1")
    assert network.rung == 1
    came_at, network.now = network.now, network.now + 5_000_000
    assert network.due() == [(b"1", came_at)]


def test_newest_sample_waits_for_the_frame_and_the_others_are_counted_and_not_read() -> None:
    network = Network(Qos())
    network.opening = Opening.CLOSED
    for number in range(5):
        network.put(b"%d" % number)
        assert network.due() == []
        network.now += LOOK_NS
    assert network.rung == 1, "the loop knows"
    assert network.told == 5, "and the engine, so that they take part in a back-off"
    network.opening = Opening.DUE
    assert [payload for payload, _ in network.due()] == [b"4"]
    assert network.intake.superseded() == {1: 4}


def test_sample_is_not_held_back_for_longer_than_a_second() -> None:
    network = Network(Qos())
    network.opening = Opening.CLOSED
    network.put(b"1")
    assert network.due() == []
    network.now += HELD_NS
    assert [payload for payload, _ in network.due()] == [b"1"]


def test_sample_waits_behind_one_that_lingers_until_a_frame_goes() -> None:
    network = Network(Qos())
    network.waits = 1
    network.put(b"1")
    assert network.due() == []
    network.opening = Opening.DUE
    assert [payload for payload, _ in network.due()] == [b"1"]


@pytest.mark.parametrize(
    "qos",
    [
        Qos(priority=Priority.REAL_TIME),
        Qos(reliability=Reliability.RELIABLE),
        Qos(reliability=Reliability.RELIABLE, durability=Durability.TRANSIENT_LOCAL),
    ],
)
def test_what_must_not_wait_or_be_lost_is_taken_at_once_whatever_the_link_does(qos: Qos) -> None:
    network = Network(qos)
    network.opening = Opening.CLOSED
    assert len(network.declared) == 1
    assert network.wakes
    network.put(b"1")
    assert network.rung == 1
    assert [payload for payload, _ in network.due()] == [b"1"]


def test_samples_from_the_channel_stay_on_their_network() -> None:
    for qos in (Qos(), Qos(reliability=Reliability.RELIABLE)):
        network = Network(qos)
        network.put(b"1", attachment=MARK)
        assert network.due() == []
        network.put(b"2")
        assert [payload for payload, _ in network.due()] == [b"2"]


def test_many_samples_do_not_wake_the_loop_while_the_link_is_busy_and_few_do_again() -> None:
    network = Network(Qos())
    network.opening = Opening.CLOSED
    for _ in range(60):
        network.put(b"x")
        network.due()
        network.now += LOOK_NS
    assert not network.wakes
    rung = network.rung
    network.put(b"y")
    assert network.rung == rung
    network.opening = Opening.DUE
    ((payload, arrived_at),) = network.due()
    assert payload == b"y"
    assert 0 <= network.now - arrived_at <= LOOK_NS, "its arrival is known that well"
    for _ in range(60):
        network.due()
        network.now += LOOK_NS
    assert network.wakes


def test_many_samples_on_a_free_link_wake_the_loop() -> None:
    network = Network(Qos())
    for _ in range(100):
        network.put(b"x")
        assert [payload for payload, _ in network.due()] == [b"x"]
        network.now += LOOK_NS
    assert network.wakes
