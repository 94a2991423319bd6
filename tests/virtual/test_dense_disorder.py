"""Dense strings that come late, twice and out of order: what is handed on is what was published.

The oracle knows nothing of coding: every sample carries a ticket, and is compared with what was
published under that ticket, wherever and whenever it comes out.
"""

import random
from collections.abc import Callable
from typing import Any, Final

import pytest

from tests.virtual.disorder import Disorder, DisorderlyNetwork
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

NAV, STATUS, COMMAND, WORD = 10, 11, 12, 13
TICKETS: Final = 60_000
SAMPLES: Final = 1_000
"""Of one run."""
WIDE: Final = LinkCapabilities(mtu_bytes=64, bit_rate_bps=50_000.0, propagation_s=3.0)
"""Far more than 31 strings are sent on it while one may still come."""
LATEST_S: Final = 5 * (WIDE.propagation_s + WIDE.airtime_ns(WIDE.mtu_bytes) / 1e9)
"""A unit and the settling time of the wire page."""
TYPES: Final = TypeTable(
    [
        TypeSpec(
            name="Nav",
            fields=(
                FieldSpec(name="ticket", type="uint16", range=(0, TICKETS)),
                FieldSpec(name="lat", type="float64", range=(43, 43.2), step=1e-6),
                FieldSpec(name="heading", type="float32", range=(0, 360), step=0.1, wraps=True),
                FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1),
            ),
        ),
        TypeSpec(
            name="Status",
            fields=(
                FieldSpec(name="ticket", type="uint16", range=(0, TICKETS)),
                FieldSpec(name="mode", type="enum", values=("idle", "survey", "home")),
                FieldSpec(name="battery", type="uint8", range=(0, 100), optional=True),
            ),
        ),
        TypeSpec(
            name="Command",
            fields=(
                FieldSpec(name="ticket", type="uint16", range=(0, TICKETS)),
                FieldSpec(name="thrust", type="float32", range=(-1, 1), step=0.01),
            ),
        ),
    ]
)


def table(rng: random.Random) -> StreamTable:
    """Two to four nodes; each dense topic has subscribers of its own."""
    nodes = tuple(range(1, rng.choice((2, 2, 3, 4)) + 1))

    def topic(stream_id: int, name: str, type_name: str = "", codec: str = "dense") -> TopicSpec:
        listed = tuple(sorted(rng.sample(nodes, rng.randint(2, len(nodes)))))
        return TopicSpec(
            stream_id=stream_id, name=f"{{node}}/{name}", type_name=type_name, codec=codec,
            qos=Qos(depth=8), subscribers=rng.choice((nodes, nodes, None, listed)),
        )  # fmt: skip

    return StreamTable(
        [
            topic(NAV, "nav", "Nav"),
            topic(STATUS, "status", "Status"),
            topic(COMMAND, "command", "Command"),
            TopicSpec(stream_id=WORD, name="{node}/word", qos=Qos(depth=8)),
        ],
        types=TYPES,
        nodes={address: f"n{address}" for address in nodes},
    )


class Voyage:
    """Vehicles that publish on a disorderly channel, and the checker of what comes out.

    Args:
        seed: Everything follows from it.
        in_haste: They publish so often that what is late is overtaken by more than 31 strings.
    """

    def __init__(self, seed: int, *, in_haste: bool = False) -> None:
        rng = self._rng = random.Random(f"voyage/{seed}")
        self._pause_s = (0.05, 0.3) if in_haste else (0.5, 2.0)
        self.disorder = Disorder(
            lost=rng.choice((0, 0.1, 0.4)),
            late=rng.choice((0, 0.1, 0.5)),
            doubled=rng.choice((0, 0.1, 0.5)),
            overtaken=rng.choice((3, 10, 31)),
            latest_s=LATEST_S if in_haste else None,
        )
        self.handed_on = 0
        self.wrong: list[object] = []
        self._tickets = 0
        self._published: dict[tuple[int, int, int], dict[str, Any]] = {}
        self._table = table(rng)
        self._course = [43.1, rng.uniform(0, 360), 20.0]
        self._is_still = rng.random() < 0.3
        self.network = DisorderlyNetwork(
            self._table, self.disorder, seed, self._take, *([WIDE] if in_haste else [])
        )

    def run(self, samples: int) -> None:
        """Publish that many samples, and what else goes on."""
        rng, nodes = self._rng, tuple(self._table.nodes)
        weights = [rng.choice((0, 1, 5)) for _ in range(3)]
        weights[rng.randrange(3)] = 5
        answers = rng.choice((0.02, 0.2, 1.0))
        while self._tickets < samples:
            if rng.random() < 0.002:
                self._is_still = not self._is_still
            for stream_id in rng.choices((NAV, STATUS, COMMAND), weights, k=rng.choice((1, 1, 3))):
                self._publish(1 if rng.random() < 0.8 else rng.choice(nodes), stream_id)
            if rng.random() < answers:
                self.network.publish(rng.choice(nodes[1:]), WORD, rng.randbytes(2))
            self.network.run(rng.uniform(*self._pause_s))

    def _publish(self, address: int, stream_id: int) -> None:
        rng = self._rng
        self._tickets += 1
        value: dict[str, Any]
        if stream_id == NAV:
            if not self._is_still:
                self._course[0] += rng.gauss(5e-6, 1e-6)
                self._course[1] = (self._course[1] + rng.gauss(0, 3)) % 360
                self._course[2] += rng.gauss(0, 0.3)
            lat, heading, depth = self._course
            value = {"lat": lat, "heading": heading, "depth": max(0.0, depth)}
        elif stream_id == STATUS:
            value = {"mode": rng.choice(("idle", "survey")), "battery": rng.choice((None, 80, 79))}
        else:
            value = {"thrust": 0.5 if self._is_still else rng.choice((-0.5, 0.0, 0.5))}
        value["ticket"] = ticket = self._tickets % (TICKETS + 1)
        codec = self._table.by_id(stream_id).codec
        self._published[address, stream_id, ticket] = codec.decode(codec.encode(value))  # type: ignore[assignment]
        self.network.publish(address, stream_id, value)

    def _take(self, address: int, event: Event) -> None:
        if not isinstance(event, SampleReceived) or event.stream_id == WORD:
            return
        self.handed_on += 1
        expected = self._published.get((event.source, event.stream_id, event.value["ticket"]))
        if expected != event.value:
            self.wrong.append((address, event, expected))


@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    "part", [0, 1, *(pytest.param(each, marks=pytest.mark.soak) for each in (2, 3))]
)
def test_what_is_late_or_doubled_is_never_read_as_something_else(
    part: int, count: Callable[[int], int]
) -> None:
    for number in range(count(500_000) // SAMPLES // 4 + 1):
        voyage = Voyage(4 * number + part)
        voyage.run(SAMPLES)
        assert voyage.wrong == [], (4 * number + part, len(voyage.wrong), voyage.handed_on)
        assert voyage.handed_on > SAMPLES / 20, 4 * number + part


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_what_is_late_is_read_as_what_it_is_however_often_a_source_speaks(
    part: int, count: Callable[[int], int]
) -> None:
    for number in range(count(50_000) // SAMPLES // 2 + 1):
        voyage = Voyage(2 * number + part, in_haste=True)
        voyage.run(SAMPLES)
        assert voyage.wrong == [], (2 * number + part, len(voyage.wrong), voyage.handed_on)
        assert voyage.handed_on > SAMPLES / 20, 2 * number + part
