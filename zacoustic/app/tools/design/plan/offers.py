"""The offered traffic: who publishes or calls what, how often, how large.

There are three sources, and the first one present counts:

* a scenario's `traffic`, the same as for `zacoustic sim`;
* a recording: what each topic published in it, at the recorded instants;
* the config alone: `min_interval_s` of a topic is its highest rate, `deadline_s` the promised one.
  A topic without either, a service or an action has no rate: it is named and left out.

Payloads are those of the values, encoded by the codec of the stream. If only the type is known,
they have the typical size: of a dense topic the one that its fit has measured, of a packed one that
of a sample within its ranges, with texts and lists half full, of a reliable one without a type half
its `max_bytes`. If that is unknown as well, they have the largest size.
"""

import itertools
import random
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from zacoustic.app.tools.design.check.bits import sample_bits, usual_bytes
from zacoustic.app.tools.design.telemetry.recording import Mission
from zacoustic.channel.traffic import TrafficSpec
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import ConfigError

_BITS: Final = 8
_BLOCK: Final = 16
"""Number of random instants drawn within as many periods: a plan is about usual traffic."""
_HEAD_BYTES: Final = 12
"""TAG, SYNC, id, number and age: reserved besides the largest record, bytes."""


class Offer:
    """One publisher of one key, or one client of one service.

    Args:
        node: Address of the node.
        stream: The published or called stream.
        instance: Key of the topic.
        every_s: Mean period, s.
        is_steady: The period is regular.
    """

    def __init__(
        self,
        node: int,
        stream: Stream,
        instance: Instance = (),
        *,
        every_s: float,
        is_steady: bool = True,
        jitter_s: float = 0.0,
        burst: int = 1,
    ) -> None:
        self.node = node
        self.voice = node
        """Node of these samples, or the one that represents it."""
        self.stream = stream
        self.instance = instance
        self.every_s = every_s
        self.is_steady = is_steady
        self.jitter_s = jitter_s
        self.burst = burst
        self.first_s: float | None = None
        """First instant, s; None: any within the first period."""
        self.until_s: float | None = None
        """No instant at or after this, s; None: no end."""
        self.answer: object = None
        """Answer to a call."""
        self._values: Sequence[object] = ()
        self._size_bytes: int | None = None
        self._instants: Sequence[float] | None = None
        self._span_s = 0.0
        self._spec: TrafficSpec | None = None

    def draws(self, spec: TrafficSpec) -> None:
        """Take values and instants from an entry of a scenario's traffic."""
        self._spec = spec
        self.first_s, self.until_s = spec.first_s, spec.until_s

    def repeats(self, values: Sequence[object], instants: Sequence[float], span_s: float) -> None:
        """Repeat recorded values at their instants, s, after each span, s."""
        self._values, self._instants, self._span_s = values, instants, span_s

    def sized(self, size_bytes: int) -> None:
        """Draw bytes of a size."""
        self._size_bytes = size_bytes

    @property
    def is_call(self) -> bool:
        """Whether it calls a service."""
        return isinstance(self.stream.spec, ServiceSpec)

    def instants(self, rng: random.Random) -> Iterator[int]:
        """Yield the instants, ns, in order except for the jitter."""
        if self._instants is not None:
            for turn in itertools.count():
                for at_s in self._instants:
                    yield seconds_to_ns(at_s + turn * self._span_s)
        at_s = rng.random() * self.every_s if self.first_s is None else self.first_s
        while self.until_s is None or at_s < self.until_s:
            for due_s in [at_s] if self.is_steady else self._at_random(at_s, rng):
                if self.until_s is None or due_s < self.until_s:
                    for _ in range(self.burst):
                        yield seconds_to_ns(due_s + rng.random() * self.jitter_s)
            at_s += self.every_s if self.is_steady else _BLOCK * self.every_s

    def _at_random(self, begin_s: float, rng: random.Random) -> list[float]:
        """Return the instants of a block of periods: as many as expected."""
        return sorted(begin_s + rng.random() * _BLOCK * self.every_s for _ in range(_BLOCK))

    def values(self, rng: random.Random) -> Iterator[object]:
        """Yield the samples or requests."""
        if self._size_bytes is not None:
            while True:
                yield rng.randbytes(self._size_bytes)
        if self._spec is None:
            yield from itertools.cycle(self._values)
        while True:
            assert self._spec is not None
            yield _draw(self._spec, rng)

    def altered(self, stream: Stream, every_s: float) -> "Offer":
        """Return the same with another stream of the same type, and another period."""
        other = Offer(
            self.node, stream, self.instance, every_s=every_s, is_steady=self.is_steady,
            jitter_s=self.jitter_s, burst=self.burst,
        )  # fmt: skip
        other.voice = self.voice
        other.first_s, other.until_s = self.first_s, self.until_s
        other.answer, other._spec = self.answer, self._spec
        other._values, other._size_bytes = self._values, self._size_bytes
        if self._instants is not None and every_s == self.every_s:
            other._instants, other._span_s = self._instants, self._span_s
        return other

    def spoken_by(self, node: int) -> "Offer":
        """Return the same, transmitted by a node that represents its own."""
        other = self.altered(self.stream, self.every_s)
        other.node = node
        return other


def offers_of_traffic(traffic: Sequence[TrafficSpec], table: StreamTable) -> list[Offer]:
    """Return the offers of a scenario, those of `zacoustic sim`."""
    offers = []
    for spec in traffic:
        name = spec.topic or spec.service or ""
        found = table.find(name, spec.node)
        wanted = TopicSpec if spec.topic else ServiceSpec
        if found is None or not isinstance(found[0].spec, wanted):
            known = ", ".join(each.name for each in table if isinstance(each.spec, wanted))
            raise ConfigError(f'traffic: "{name}" of node {spec.node}; allowed: {known or "none"}')
        stream, instance = found
        offer = Offer(
            spec.node, stream, instance, every_s=spec.every_s,
            is_steady=spec.pattern == "periodic", jitter_s=spec.jitter_s, burst=spec.burst,
        )  # fmt: skip
        offer.draws(spec)
        offer.answer = spec.answer
        offers.append(offer)
    return offers


def offers_of_recording(
    missions: Sequence[Mission], table: StreamTable, nodes: Sequence[int]
) -> list[Offer]:
    """Return the offers of recordings: each mission is one vehicle."""
    offers = []
    taken: dict[int, set[int]] = {}
    for mission in missions:
        if len(mission.samples) < 2:
            continue
        begin_s, end_s = mission.samples[0][0], mission.samples[-1][0]
        for stream_id in mission.types:
            stream = table.by_id(stream_id)
            own = [(at, value) for at, each, value in mission.samples if each == stream_id]
            publisher = _next_publisher(stream, nodes, taken.setdefault(stream_id, set()))
            if not own or publisher is None:
                continue
            span_s = (end_s - begin_s) * (1 + 1 / max(1, len(own) - 1))
            offer = Offer(publisher, stream, every_s=span_s / len(own), is_steady=_is_steady(own))
            names = {field.name for field in stream.type.fields} if stream.type else set()
            offer.repeats(
                [{k: v for k, v in value.items() if k in names} for _, value in own],
                [at - begin_s for at, _ in own],
                span_s,
            )  # fmt: skip
            offers.append(offer)
    return offers


def offers_of_config(
    table: StreamTable, nodes: Sequence[int], typical: Mapping[int, float], room_bytes: int
) -> tuple[list[Offer], list[str]]:
    """Return the offers that a table permits or promises, and remarks on them."""
    offers: list[Offer] = []
    notes: list[str] = []
    for stream in table:
        spec, qos = stream.spec, stream.qos
        every_s = qos.min_interval_s or qos.deadline_s
        if not isinstance(spec, TopicSpec) or not every_s:
            key = "min_interval_s or deadline_s" if isinstance(spec, TopicSpec) else "no key"
            notes.append(
                f"{stream.name}: nothing says how often it speaks ({key} of the file, a scenario's "
                "traffic, or --recording): left out"
            )
            continue
        size_bytes, is_known = _usual_bytes(stream, typical, room_bytes)
        if not is_known:
            notes.append(f"{stream.name}: reckoned with its largest sample, {size_bytes} bytes")
        for node in nodes:
            if stream.may_publish(node):
                for instance in _instances(stream):
                    offer = Offer(node, stream, instance, every_s=every_s)
                    offer.sized(size_bytes)
                    offers.append(offer)
    return offers, notes


def _draw(spec: TrafficSpec, rng: random.Random) -> object:
    size = spec.size_bytes
    if size is not None:
        return rng.randbytes(rng.randint(*size) if isinstance(size, tuple) else size)
    if not spec.vary:
        return spec.value
    return {**spec.value, **{key: rng.uniform(*ends) for key, ends in spec.vary.items()}}


def _next_publisher(stream: Stream, nodes: Sequence[int], taken: set[int]) -> int | None:
    """Return a node that publishes a topic and has none of the missions yet."""
    for node in sorted(nodes, reverse=True):
        if node not in taken and stream.may_publish(node):
            taken.add(node)
            return node
    return None


def _is_steady(own: Sequence[tuple[float, object]]) -> bool:
    gaps = [after[0] - before[0] for before, after in itertools.pairwise(own)]
    return bool(gaps) and max(gaps) < 2 * sum(gaps) / len(gaps)


def _instances(stream: Stream) -> Iterator[Instance]:
    counts = [range(len(wildcard.values)) for wildcard in stream.keys.wildcards]
    return itertools.product(*counts)


def _usual_bytes(stream: Stream, typical: Mapping[int, float], room_bytes: int) -> tuple[int, bool]:
    """Return the size of a payload, and whether it is known, not just the largest possible."""
    bits = sample_bits(stream, stream.codec, typical)
    if bits is not None and bits.typical is not None:
        return -(-int(bits.typical) // _BITS), True
    usual = usual_bytes(stream)
    if usual is not None:
        return usual, True
    smallest, largest = stream.codec.smallest_bytes, stream.codec.largest_bytes
    if largest is None and isinstance(stream.spec, TopicSpec) and stream.spec.max_bytes:
        # A bound is set with room: twice of what is usual, as `config init` does it.
        return max(1, stream.spec.max_bytes // 2), True
    if largest is None:
        return max(smallest, room_bytes - _HEAD_BYTES - len(stream.keys.wildcards)), False
    return largest, smallest == largest
