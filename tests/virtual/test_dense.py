"""Dense streams between engines: whatever is lost, what arrives is what was published."""

import random
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, Final

import pytest

from tests.telemetry.crossing import WAYS, Way, cross
from tests.virtual.fleet import line
from zacoustic.core.base.qos import Qos, Stamp
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import PayloadTooLargeError
from zacoustic.testing.virtual import Modem, VirtualNetwork

NAV: Final = TypeSpec(
    name="Nav",
    fields=(
        FieldSpec(name="ticket", type="uint16", range=(0, 60_000)),
        FieldSpec(name="lat", type="float64", range=(43, 43.2), step=1e-6),
        FieldSpec(name="lon", type="float64", range=(5.9, 6.1), step=1e-6),
        FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1),
        FieldSpec(name="heading", type="float32", range=(0, 360), step=0.1, wraps=True),
        FieldSpec(name="speed", type="float32", range=(-1, 4), step=0.01),
    ),
)
STATUS: Final = TypeSpec(
    name="Status",
    fields=(
        FieldSpec(name="ticket", type="uint16", range=(0, 60_000)),
        FieldSpec(name="armed", type="bool"),
        FieldSpec(name="mode", type="enum", values=("idle", "survey", "home")),
        FieldSpec(name="battery", type="uint8", range=(0, 100), optional=True),
    ),
)


def fleet(codec: str = "dense", nodes: int = 2, stamp: Stamp = Stamp.NONE) -> StreamTable:
    everybody = tuple(range(1, nodes + 1))
    return StreamTable(
        [
            TopicSpec(
                stream_id=10, name="{node}/nav", type_name="Nav", codec=codec,
                qos=Qos(depth=20, stamp=stamp), subscribers=everybody,
            ),
            TopicSpec(
                stream_id=11, name="{node}/status", type_name="Status", codec=codec,
                qos=Qos(depth=20), subscribers=everybody,
            ),
            TopicSpec(stream_id=12, name="{node}/log", qos=Qos(depth=20)),
        ],
        types=TypeTable([NAV, STATUS]),
        nodes={address: f"n{address}" for address in everybody},
    )  # fmt: skip


class Voyage:
    """Nodes that publish what vehicles do; every sample carries a ticket.

    Args:
        seed: Everything follows from it.
        codec: Of the typed streams.
        nodes: How many.
        settings: Of the scenario.
    """

    def __init__(
        self, seed: int, codec: str = "dense", nodes: int = 2, stamp: Stamp = Stamp.NONE,
        modem: Modem | None = None, **settings: Any,
    ) -> None:  # fmt: skip
        self.seed = seed
        self.restarts = False
        self.rng = random.Random(f"dense/{seed}")
        self.published: dict[tuple[int, int, int], dict[str, Any]] = {}
        self.arrived: dict[tuple[int, int, int, int], int] = defaultdict(int)
        self.wrong: list[object] = []
        self._tickets = 0
        self._ways = {
            address: [43.1, 6.0, 20.0, self.rng.uniform(0, 360), 1.2]
            for address in range(1, nodes + 1)
        }
        table = fleet(codec, nodes, stamp)
        positions = [500.0 * address for address in range(nodes)]
        self.medium = VirtualNetwork(
            line(*positions, seed=seed, **settings), table,
            modem=modem or Modem(), deliver=self._take, digest=False,
        )  # fmt: skip

    def publish_nav(self, address: int) -> None:
        rng, way = self.rng, self._ways[address]
        way[3] = (way[3] + rng.gauss(0, 3)) % 360
        way[0] += rng.gauss(5e-6, 1e-6)
        way[2] = min(max(way[2] + rng.gauss(0, 0.3), 0), 1000)
        nav = {
            "lat": way[0], "lon": way[1], "depth": way[2], "heading": way[3],
            "speed": 1.2 + rng.gauss(0, 0.02),
        }  # fmt: skip
        self._publish(address, 10, nav)

    def publish_status(self, address: int) -> None:
        rng = self.rng
        status = {
            "armed": rng.random() < 0.5,
            "mode": rng.choice(("idle", "survey", "home")),
            "battery": rng.choice((None, 80, 79)),
        }
        self._publish(address, 11, status)

    def _publish(self, address: int, stream_id: int, value: dict[str, Any]) -> None:
        self._tickets += 1
        value["ticket"] = self._tickets % 60_001
        stream = self.medium.engine(address).table.by_id(stream_id)
        self.published[address, stream_id, value["ticket"]] = stream.codec.decode(  # type: ignore[assignment]
            stream.codec.encode(value)
        )
        self.medium.publish(address, stream_id, value)

    def dropped(self, reason: str) -> int:
        return sum(
            self.medium.engine(address).stats.dropped.get(reason, 0) for address in self._ways
        )

    def received(self) -> int:
        return sum(self.arrived.values())

    def _take(self, address: int, event: Event) -> None:
        if not isinstance(event, SampleReceived) or event.stream_id == 12:
            return
        name = (event.source, event.stream_id, event.value["ticket"])
        if self.published.get(name) != event.value:
            self.wrong.append((address, event, self.published.get(name)))
        self.arrived[(address, *name)] += 1


def test_dense_samples_cross_and_take_fewer_bytes_once_they_are_acknowledged() -> None:
    sizes = {}
    for codec in ("packed", "dense"):
        voyage = Voyage(1, codec, channel="none")
        for number in range(100):
            voyage.medium.at(10 * number, partial(voyage.publish_nav, 1))
            voyage.medium.at(10 * number + 5, partial(voyage.medium.publish, 2, 12, b"log"))
        voyage.medium.run(until_s=1100)
        assert voyage.wrong == []
        assert voyage.received() == 100
        sizes[codec] = voyage.medium.engine(1).stats.bytes_transmitted
        assert not voyage.dropped("dense")
    assert sizes["dense"] < 0.75 * sizes["packed"], sizes


def test_receiver_that_never_speaks_costs_no_more_than_packed() -> None:
    sizes = {}
    for codec in ("packed", "dense"):
        voyage = Voyage(2, codec, channel="none")
        for number in range(300):
            voyage.medium.at(10 * number, partial(voyage.publish_nav, 1))
        voyage.medium.run(until_s=3100)
        sizes[codec] = voyage.medium.engine(1).stats.bytes_transmitted
        assert voyage.wrong == []
        assert voyage.received() == 300
        assert voyage.medium.engine(2).stats.frames_transmitted <= 3
    assert sizes["dense"] <= 1.01 * sizes["packed"], sizes


BYTE_S: Final = 0.0111
NOISE: Final = TypeSpec(
    name="Noise", fields=tuple(FieldSpec(name=f"n{place}", type="uint8") for place in range(4))
)


@pytest.mark.parametrize("way", WAYS, ids=[way.name for way in WAYS])
def test_noise_costs_hardly_more_airtime_than_packed_whatever_comes_back(way: Way) -> None:
    rng = random.Random(7)
    values = [{f"n{place}": rng.randrange(256) for place in range(4)} for _ in range(150)]
    dense, packed = (
        cross(NOISE, values, codec, way, loss=0.1, seed=3) for codec in ("dense", "packed")
    )
    # What finding out may cost: six bytes at the beginning, what is acknowledged until then, and
    # a byte in 32 frames.
    assert dense.airtime_s <= packed.airtime_s + 26 * BYTE_S
    assert dense.delivered >= packed.delivered > 100


def test_age_is_part_of_a_dense_string() -> None:
    voyage = Voyage(3, stamp=Stamp.AGE, channel="none")
    ages = []
    take = voyage._take

    def look(address: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and event.stream_id == 10:
            ages.append(event.age_s)
        take(address, event)

    voyage.medium._deliver = look
    for number in range(20):
        voyage.medium.at(10 * number, partial(voyage.publish_nav, 1))
        voyage.medium.at(10 * number, partial(voyage.publish_nav, 1))
    voyage.medium.run(until_s=300)
    assert len(ages) > 30
    assert all(age is not None and 0 <= age < 10 for age in ages)
    assert len(set(ages)) > 1


def test_an_attitude_comes_back_within_half_a_step() -> None:
    step = 0.001
    parts = tuple(
        FieldSpec(name=f"q{part}", type="float64", range=(-1, 1), step=step) for part in "xyzw"
    )
    pose = TypeSpec(name="Pose", fields=(FieldSpec(name="ticket", type="uint16"), *parts))
    table = StreamTable(
        [TopicSpec(stream_id=10, name="pose", type_name="Pose", codec="dense")],
        types=TypeTable([pose]),
        nodes={1: "n1", 2: "n2"},
    )
    rng = random.Random(5)
    sent: list[dict[str, float]] = []
    errors: list[float] = []

    def look(address: int, event: Event) -> None:
        if isinstance(event, SampleReceived):
            value = sent[event.value["ticket"]]
            errors.append(max(abs(value[each.name] - event.value[each.name]) for each in parts))

    medium = VirtualNetwork(line(0.0, 500.0, channel="none"), table, deliver=look, digest=False)
    for number in range(100):
        angles = [rng.uniform(-0.3, 0.3) for _ in range(3)]
        norm = (1 + sum(angle * angle for angle in angles)) ** 0.5
        value = {f"q{part}": angle / norm for part, angle in zip("xyz", angles, strict=True)}
        sent.append({"ticket": number, **value, "qw": 1 / norm})
        medium.at(10 * number, partial(medium.publish, 1, 10, sent[-1]))
    medium.run(until_s=1100)
    assert len(errors) > 90
    assert max(errors) <= step / 2 + 1e-9


def test_texts_without_a_type_cross_packed_and_in_dense_strings() -> None:
    lines = [f"INF battery: {250 - number} V, {number} A".encode() for number in range(30)]
    lines += [b"", b"\xff\xfe\xfd", bytes(range(40))]
    sizes = {}
    for codec in ("cbor", "packed", "dense"):
        table = StreamTable(
            [
                TopicSpec(stream_id=10, name="log", codec=codec, subscribers=(2,)),
                TopicSpec(stream_id=11, name="back", subscribers=(1,)),
                TopicSpec(
                    stream_id=12, name="aged", codec=codec, qos=Qos(stamp=Stamp.AGE),
                    subscribers=(2,),
                ),
            ],
            nodes={1: "n1", 2: "n2"},
        )  # fmt: skip
        arrived: dict[int, list[Any]] = defaultdict(list)

        def look(address: int, event: Event, arrived: dict[int, list[Any]] = arrived) -> None:
            if isinstance(event, SampleReceived):
                arrived[event.stream_id].append(event.value)
                assert (event.age_s is not None) == (event.stream_id == 12)

        medium = VirtualNetwork(line(0.0, 500.0, channel="none"), table, deliver=look, digest=False)
        for number, text in enumerate(lines):
            medium.at(20 * number, partial(medium.publish, 1, 10, text))
            medium.at(20 * number + 5, partial(medium.publish, 2, 11, b""))
            medium.at(20 * number + 10, partial(medium.publish, 1, 12, text))
        medium.run(until_s=20 * len(lines) + 20)
        assert arrived[10] == arrived[12] == lines
        sizes[codec] = medium.engine(1).stats.bytes_transmitted
    assert sizes["packed"] < 0.65 * sizes["cbor"], sizes
    assert sizes["dense"] < 0.9 * sizes["packed"], sizes


def nmea(number: int) -> bytes:
    rest = f"N,00556.{7000000 + 41 * number:07d},E,1,08,1.03,61.7,M,55.2,M,,*47"
    return f"$GPGGA,{120000 + number}.00,4317.{1200000 + 37 * number:07d},{rest}".encode()


def sentences(
    loss: float, restart_s: float | None = None, linger_s: float = 0.0
) -> tuple[list[bytes], VirtualNetwork]:
    """Publish NMEA sentences, most of which fit no frame as records; the first one does."""
    table = StreamTable(
        [
            TopicSpec(
                stream_id=10, name="nmea", codec="dense", publishers=(1,), subscribers=(2,),
                qos=Qos(linger_s=linger_s),
            ),
            TopicSpec(stream_id=11, name="back", publishers=(2,), subscribers=(1,)),
            TopicSpec(stream_id=12, name="log", publishers=(1,), subscribers=(2,)),
        ],
        nodes={1: "n1", 2: "n2"},
    )  # fmt: skip
    arrived: list[bytes] = []

    def look(address: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and event.stream_id == 10:
            arrived.append(event.value)

    scenario = line(0.0, 500.0, channel="none", loss={"frame": loss}, seed=3)
    medium = VirtualNetwork(scenario, table, deliver=look, digest=False, modem=Modem(mtu_bytes=60))
    medium.at(0, partial(medium.publish, 2, 11, b""))
    medium.at(10, partial(medium.publish, 1, 10, b"$GPGGA,120000.00,4317.1200000,N"))
    medium.at(15, partial(medium.publish, 2, 11, b""))

    def publish(text: bytes) -> None:
        with suppress(PayloadTooLargeError):
            medium.publish(1, 10, text)

    for number in range(40):
        medium.at(20 + 20 * number, partial(publish, nmea(number)))
        medium.at(35 + 20 * number, partial(medium.publish, 1, 12, b"log"))
        medium.at(28 + 20 * number, partial(medium.publish, 2, 11, b""))
    if restart_s is not None:
        medium.at(restart_s, partial(medium.restart, 2))
    medium.run(until_s=900)
    return arrived, medium


def test_a_text_crosses_whose_block_fits_beside_a_reference_only() -> None:
    arrived, medium = sentences(0.0)
    with pytest.raises(PayloadTooLargeError, match="a frame of this link has room") as caught:
        medium.publish(1, 10, random.Random(1).randbytes(100))
    assert 'codec: "packed" and reliability: "reliable"' in str(caught.value.hint)
    assert len(PackedBytesCodec().encode(nmea(7))) > 58
    assert arrived[1:] == [nmea(number) for number in range(40)]


def test_a_text_whose_reference_is_lost_while_it_waits_is_dropped_and_counted() -> None:
    arrived, medium = sentences(0.0, restart_s=220.5, linger_s=12)
    assert 5 <= len(arrived) < 30
    assert medium.engine(1).stats.dropped["oversized"] == 1
    assert medium.engine(1).stats.transmitted[12] >= 39
    assert medium.engine(1).pending(10) == 0


@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_a_text_that_has_lost_its_reference_holds_nothing_up(loss: float) -> None:
    arrived, medium = sentences(loss, restart_s=220.5)
    assert set(arrived[1:]) <= {nmea(number) for number in range(40)}
    assert 5 <= len(arrived) < 30
    assert medium.engine(1).stats.transmitted[12] >= 39
    assert medium.engine(1).pending(10) == 0


def tell(seed: int) -> Voyage:
    """Run a scenario of two to four vehicles in bad water."""
    rng = random.Random(f"weather/{seed}")
    nodes = rng.choice((2, 2, 3, 4))
    voyage = Voyage(
        seed,
        nodes=nodes,
        stamp=rng.choice((Stamp.NONE, Stamp.AGE)),
        modem=Modem(acknowledges=rng.random() < 0.3),
        channel="none",
        loss={"frame": rng.choice((0.0, 0.1, 0.3, 0.6))},
        faults={
            "duplicate": rng.choice((0, 0.1)),
            "jitter_s": rng.choice((0, 0, 3.0)),
            "corrupt": rng.choice((0, 0, 0.1)),
        },
    )
    medium = voyage.medium
    for address in range(1, nodes + 1):
        at_s = rng.uniform(0, 10)
        period_s = rng.choice((4.0, 10.0, 30.0))
        while at_s < 900:
            medium.at(at_s, partial(voyage.publish_nav, address))
            if rng.random() < 0.3:
                medium.at(at_s, partial(voyage.publish_status, address))
            if rng.random() < 0.1:
                medium.at(at_s, partial(medium.publish, address, 12, b"text"))
            at_s += period_s * rng.uniform(0.9, 1.1)
    if rng.random() < 0.3:
        voyage.restarts = True
        medium.at(rng.uniform(100, 800), partial(medium.restart, rng.randint(1, nodes)))
    medium.run(until_s=1500)
    return voyage


@pytest.mark.parametrize("part", range(4))
def test_whatever_goes_wrong_nothing_is_decoded_wrongly(
    part: int, count: Callable[[int], int]
) -> None:
    for number in range(count(600) // 4 + 1):
        voyage = tell(4 * number + part)
        assert voyage.wrong == [], voyage.seed
        assert voyage.received() > 0, voyage.seed
        if not voyage.restarts and not voyage.medium.scenario.faults.corrupt:
            # What is received can be decoded, whatever else was lost, repeated or late.
            assert voyage.dropped("dense") == 0, voyage.seed


@pytest.mark.parametrize(("jitter_ns", "most_bytes"), [(0, 3.0), (1_000_000, 5.5)])
def test_a_stamp_in_nanoseconds_costs_what_its_jitter_does(
    jitter_ns: int, most_bytes: float
) -> None:
    stamped = TypeSpec(name="Stamped", fields=(FieldSpec(name="stamp", type="uint64"),))
    table = StreamTable(
        [
            TopicSpec(
                stream_id=10, name="auv/stamped", type_name="Stamped", codec="dense",
                subscribers=(2,),
            ),
            TopicSpec(stream_id=12, name="shore/word", subscribers=(1,)),
        ],
        types=TypeTable([stamped]),
        nodes={1: "auv", 2: "shore"},
    )  # fmt: skip
    rng, stamp, published = random.Random(4), 1_700_000_000_000_000_000, []
    medium = VirtualNetwork(line(0.0, 500.0, channel="none"), table, digest=False)
    for number in range(120):
        stamp += 10_000_000_000 + round(rng.gauss(0, jitter_ns))
        published.append(stamp)
        medium.at(10 * number, partial(medium.publish, 1, 10, {"stamp": stamp}))
        medium.at(10 * number + 5, partial(medium.publish, 2, 12, b""))
    medium.run(until_s=395)
    before_bytes = medium.engine(1).stats.bytes_transmitted
    medium.run(until_s=1300)
    assert [each.value["stamp"] for each in medium.samples(2, 10)] == published
    # With the acknowledgements of the words, and all else that a frame has.
    assert (medium.engine(1).stats.bytes_transmitted - before_bytes) / 80 <= most_bytes
