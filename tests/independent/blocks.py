"""Annex C: the samples of dense blocks. Written from docs/wire.md alone.

`Reader` is the receiving end of one source's blocks (section 7.2). `write_alone` is the least
sender of C.8.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tests.independent import curves, dense, describe, packed, texts
from tests.independent.arithmetic import Coder, Sink, Source
from tests.independent.columns import Columns, Kind, Part, Row
from tests.independent.cursor import BitOutput, Bits, Cursor
from tests.independent.errors import ReadError
from tests.independent.rows import (
    MOST_HOLD,
    SITUATIONS,
    Adaptation,
    Manner,
    Rows,
    State,
    class_of,
    halves,
)
from tests.independent.table import Field, Table, Topic, Types

_STEADY = 61440
_SAME, _PLAIN = 8192, 2048
_KEPT = 8
_STEPS = (240, 320, 200, 160, 130, 100, 80, 60, 50, 40, 30, 25, 20, 15, 12, 40)
_MOST_SAMPLES = 255
_WINDOW = 1 << 22
_AGAINST, _BY_MODEL, _PLAINLY = range(3)
_GENERATIONS = 16


class _CodedBits(Bits):
    """The bits of a part, out of a block."""

    def __init__(self, source: Coder) -> None:
        super().__init__(Cursor(b""))
        self._source = source

    def take(self, count: int) -> int:
        return self._source.bits(count)

    def bytes(self, count: int) -> bytes:
        return bytes(self.take(8) for _ in range(count))

    @property
    def left(self) -> int:
        return 1 << 20  # a block that ends before is refused in any case


class _CodedBitOutput(BitOutput):
    def __init__(self, sink: Coder) -> None:
        super().__init__()
        self._sink = sink

    def put(self, value: int, count: int) -> None:
        self._sink.bits(count, value)


class Prior:
    """What a model says of a stream (C.7)."""

    def __init__(self, columns: Columns, rows: Rows, said: Mapping[str, Any]) -> None:
        every = columns.columns
        if said and said["sizes"] != [each.size for each in every]:
            raise ReadError("a model for another type")
        self.firsts: list[Any] = said.get("firsts", [])
        self.steadiness = tuple(said.get("steadiness") or [_STEADY] * len(every))
        self.lines: list[str] = said.get("lines", [])
        self.present: int = said.get("present", 0)
        self.more: list[int] = said.get("more", [])
        self.adaptations = {
            int(place): _adaptation(rows.count, learnt)
            for place, learnt in said.get("learnt", {}).items()
        }


def _adaptation(count: int, learnt: Mapping[str, Any]) -> Adaptation:
    weights = [
        sum(learnt["weights"][k][i] << 96 * (count - 1 - k) for k in range(i + 1, count))
        for i in range(count)
    ]
    manners = zip(learnt["log_scales"], learnt["nearer"], learnt["holds"], strict=True)
    return Adaptation(
        weights=tuple(weights),
        energies=tuple(learnt["energies"]),
        manners=tuple(Manner(*each) for each in manners),
        widths=tuple(learnt["widths"]),
    )


class Stream:
    """Codes the samples of one stream (C.3)."""

    def __init__(self, types: Types, name: str, said: Mapping[str, Any]) -> None:
        self.columns = Columns(types, name)
        self.rows = Rows(self.columns)
        self.prior = Prior(self.columns, self.rows, said)
        lines = self.prior.lines
        self._known = texts.known(lines) if lines else None

    def read(
        self,
        coder: Coder,
        stream_id: int,
        before: State | None,
        steps: int,
        beside: Mapping[int, Row],
    ) -> tuple[dict[str, Any], State]:
        row: Row = [None] * len(self.columns.columns)
        rest: list[Any] = [None] * len(self.columns.parts)
        if before is not None:
            way = coder.shares((60, 3, 1))
        else:
            way = 1 + coder.shares((3, 1))
        kept = ((),) * len(rest) if before is None else before.kept
        steadiness = self.prior.steadiness if before is None else before.steadiness
        adaptations = self.prior.adaptations if before is None else before.adaptations
        velocity: list[int] | None = None
        if way == _AGAINST:
            assert before is not None
            steadiness = self._symbols(coder, row, before)
            place = class_of(steps, before)
            velocity, learnt = self.rows.code(
                coder, row, before, self._of_class(before.adaptations, place), steps
            )
            adaptations = {**adaptations, place: learnt}
        elif way == _BY_MODEL and self.prior.firsts:
            self._by_model(coder, row, stream_id, beside)
        else:
            self._plainly(coder, row)
        if way != _AGAINST and before is not None:
            velocity = self._strides(row, before.row, steps)
        kept = self._rest(coder, row, rest, kept, plainly=way == _PLAINLY)
        known = row if before is None else before.row
        whole = [old if new is None else new for new, old in zip(row, known, strict=True)]
        return self.columns.join(row, rest), State(whole, velocity, adaptations, steadiness, kept)

    def write(self, coder: Coder, value: Mapping[str, Any]) -> None:
        """Write a sample without one before it, plainly."""
        row, rest = self.columns.split(value)
        coder.shares((3, 1), 1)
        self._plainly(coder, row)
        for place, part in enumerate(self.columns.parts):
            if not self.columns.is_missing(part.guard, row):
                self._put(coder, part, rest[place])

    def _plainly(self, coder: Coder, row: Row) -> None:
        for n in (*self.columns.symbols, *self.columns.numbers):
            column = self.columns.columns[n]
            if not self.columns.is_missing(column.guard, row):
                row[n] = coder.one_of(column.size, row[n] or 0)

    def _by_model(self, coder: Coder, row: Row, stream_id: int, beside: Mapping[int, Row]) -> None:
        for n in (*self.columns.symbols, *self.columns.numbers):
            column = self.columns.columns[n]
            if self.columns.is_missing(column.guard, row):
                continue
            center, scale, held, hold, companion = self.prior.firsts[n]
            if companion is not None:
                other, place, slope, offset, near = companion
                there = row if other == stream_id else beside.get(other, [])
                z = there[place] if place < len(there) else None
                if z is not None:
                    center, scale = offset + (z * slope >> 12), near
            size = column.size
            if scale and size > 1:
                row[n] = _around(coder, size, center, scale, held, min(hold, MOST_HOLD))
            elif size > 1 and coder.flag(max(hold, 1)):
                row[n] = held % size
            else:
                row[n] = coder.one_of(size)

    def _symbols(self, coder: Coder, row: Row, before: State) -> tuple[int, ...]:
        steadiness = list(before.steadiness)
        for n in self.columns.symbols:
            column, old, p = self.columns.columns[n], before.row[n], steadiness[n]
            if self.columns.is_missing(column.guard, row):
                continue
            if old is None:
                row[n] = coder.one_of(column.size)
            elif column.size == 1:
                row[n] = 0
            elif coder.flag(p):
                row[n] = old
                steadiness[n] = min(p + ((65536 - p) >> 5), 65280)
            else:
                other = coder.one_of(column.size - 1)
                row[n] = other + (other >= old)
                steadiness[n] = max(p - (p >> 5), 256)
        return tuple(steadiness)

    def _of_class(self, adaptations: Mapping[int, Adaptation], place: int) -> Adaptation:
        found, priors = adaptations.get(place), self.prior.adaptations
        if found is None:
            if not adaptations:
                return self.rows.new()
            return adaptations[min(adaptations, key=lambda each: (abs(each - place), each))]
        learnt = [each for each in priors if each and adaptations.get(each) is not priors[each]]
        if not place or found is not priors.get(place) or not learnt:
            return found
        other = min(learnt, key=lambda each: (abs(each - place), each))
        return _carried(
            self.rows.count, found, priors[other], adaptations[other], abs(other - place)
        )

    def _strides(self, row: Row, old_row: Row, steps: int) -> list[int] | None:
        found = [0] * len(row)
        for n in self.rows.large:
            new, old = row[n], old_row[n]
            if new is not None and old is not None and abs(new - old) >= (1 << 20) * steps:
                found[n] = 16 * (new - old) // steps
        return found if any(found) else None

    def _rest(
        self,
        coder: Coder,
        row: Row,
        rest: list[Any],
        kept: tuple[tuple[object, ...], ...],
        *,
        plainly: bool,
    ) -> tuple[tuple[object, ...], ...]:
        now = list(kept)
        for place, part in enumerate(self.columns.parts):
            if self.columns.is_missing(part.guard, row):
                continue
            before = kept[place]
            if plainly:
                value = self._take(coder, part)
            elif before and coder.flag(_SAME):
                value = before[-1]
            elif part.kind is Kind.OTHER or coder.flag(_PLAIN):
                value = self._take(coder, part)
            else:
                value = self._text(coder, part, before)
            rest[place] = value
            count = 1 if part.kind is Kind.OTHER else _KEPT
            now[place] = (*before, value)[-count:]
        return tuple(now)

    def _text(self, coder: Coder, part: Part, before: tuple[object, ...]) -> object:
        recent = [each.encode() if isinstance(each, str) else each for each in before]
        is_string = part.kind is Kind.STRING
        known = self._known if is_string and self._known is not None else texts.known_texts()
        text = texts.code(coder, known, recent)  # type: ignore[arg-type]
        most = part.fields[0].max_length
        if most is not None and len(text) > most:
            raise ReadError("too long")
        if len(text) < part.fields[0].min_length:
            raise ReadError("too short")
        try:
            return text.decode() if is_string else text
        except UnicodeDecodeError as error:
            raise ReadError("no UTF-8") from error

    def _take(self, coder: Coder, part: Part) -> object:
        bits = _CodedBits(coder)
        found = {
            each.name: packed.read_field(self.columns.types, each, bits) for each in part.fields
        }
        return found if len(part.fields) > 1 else found[part.fields[0].name]

    def _put(self, coder: Coder, part: Part, value: Any) -> None:
        writer = _CodedBitOutput(coder)
        for each in part.fields:
            one = value[each.name] if len(part.fields) > 1 else value
            packed.put_field(self.columns.types, each, one, writer)


def _around(coder: Coder, size: int, center: int, scale: int, held: int, hold: int) -> int:
    center = min(max(center, -16 * size), 32 * size)
    least, count = 0, size
    if size > _WINDOW:
        count = _WINDOW
        least = min(max((center >> 4) - count // 2, 0), size - count)
    grade = (curves.log_scale(scale) + curves.WIDTH) >> 6
    return least + curves.number(coder, count, center - 16 * least, grade, held - least, hold)


def _carried(
    count: int, own: Adaptation, start: Adaptation, end: Adaptation, apart: int
) -> Adaptation:
    weights = []
    for i, (weight, old, new) in enumerate(
        zip(own.weights, start.weights, end.weights, strict=True)
    ):
        if apart == 1:
            weights.append(weight + new - old)
            continue
        places = [96 * (count - 1 - k) for k in range(i + 1, count)]
        half, ones = halves(places), sum(1 << place for place in places)
        weights.append(((2 * weight + new - old + half) >> 1 & (half - ones)) - (half >> 1))
    manners = [
        Manner(
            min(max(mine.log_scale + new.log_scale - old.log_scale, 0), 32768),
            min(max(mine.nearer + new.nearer - old.nearer, 0), 65536),
            mine.hold,
        )
        for mine, old, new in zip(own.manners, start.manners, end.manners, strict=True)
    ]
    assert len(end.widths) == SITUATIONS * len(manners)
    return Adaptation(tuple(weights), own.energies, tuple(manners), end.widths)


@dataclass(frozen=True)
class Habit:
    """What blocks usually hold of one stream (C.2)."""

    more: tuple[int, ...]
    regular: int = 57344
    steps: tuple[int, ...] = _STEPS

    def after_steps(self, first: int) -> "Habit":
        after = [each - (each >> 2) + s // 16 for each, s in zip(self.steps, _STEPS, strict=True)]
        grown = 2048 // (first + 1)
        for place in range(first - 1):
            after[place] += grown
        after[first - 1] += 2 * grown
        return replace(self, steps=tuple(after))

    def after_more(self, sample: int, is_more: bool) -> "Habit":
        place = min(sample, 12) - 1
        changed = _after(self.more[place], is_more)
        return replace(self, more=(*self.more[:place], changed, *self.more[place + 1 :]))


def _after(p: int, is_set: bool) -> int:
    return min(max(p + ((65536 - p if is_set else -p) >> 2), 512), 65024)


@dataclass(frozen=True)
class Block:
    """A block that was read, and its state."""

    digest: bytes
    streams: tuple[tuple[State | None, Habit], ...]
    single: int
    chances: tuple[int, ...]
    in_turn: int = 57344
    name: int | None = None
    turn: int | None = None
    ancestors: tuple[bytes, ...] = ()

    @property
    def mark(self) -> int:
        return dense.mark_of(self.digest)

    def is_outdated_by(self, other: "Block") -> bool:
        """Tell whether the other's reference descends from this one's."""
        return bool(self.ancestors) and self.ancestors[0] in other.ancestors[1:]


class Reader:
    """Reads the blocks of a source.

    Args:
        types: The types of the table.
        streams: Name of the type of each dense topic that the source may publish, by id.
        table_digest: Digest of the table.
        model_text: The model, if there is one.
    """

    def __init__(
        self, types: Types, streams: Mapping[int, str], table_digest: bytes, model_text: str = "{}"
    ) -> None:
        model = json.loads(model_text)
        said = model.get("streams", {})
        self.ids = sorted(streams)
        self.streams = [Stream(types, streams[n], said.get(str(n), {})) for n in self.ids]
        digest = hashlib.sha256(model_text.encode()).digest()[:4] if model else b""
        habits, chances = [], []
        for stream in self.streams:
            prior, chance = stream.prior, min(32768, 98304 // len(self.ids))
            more: tuple[int, ...] = (32768,) * 12
            if prior.present:
                chance = prior.present
                last = prior.more[-1] if prior.more else 32768
                more = (*prior.more, *(last,) * 12)[:12]
            chances.append(max(chance, 512))
            habits.append(Habit(more))
        self.root = Block(
            digest=dense.root(table_digest, digest),
            streams=tuple((None, habit) for habit in habits),
            single=model.get("single") or 32768,
            chances=tuple(chances),
        )
        self._held: dict[int, Block] = {}

    def read(self, data: bytes) -> tuple[list[tuple[int, dict[str, Any]]], Block]:
        """Read a block: its samples, and the block, which is held then."""
        samples, block = self.look_at(data)
        self._hold(block)
        return samples, block

    def look_at(self, data: bytes) -> tuple[list[tuple[int, dict[str, Any]]], Block]:
        """Read a block without holding it."""
        source = Source(data)
        head = dense.take_head(source)
        kind, known = head.kind, self.root
        if head.name is not None:
            if head.name not in self._held:
                raise ReadError("its reference is not held")
            known = self._held[head.name]
        samples: list[tuple[int, dict[str, Any]]] = []
        streams, distance = list(known.streams), 1
        if kind == dense.SINGLE:
            places = [source.one_of(len(streams))]
            value, state = self.streams[places[0]].read(source, self.ids[places[0]], None, 1, {})
            streams[places[0]] = state, streams[places[0]][1]
            samples.append((self.ids[places[0]], value))
        else:
            places = _places(source, known)
            distance = self._samples(source, places, streams, samples)
        if not samples:
            raise ReadError("no sample")
        form, in_turn = _form(source, known, refers=kind == dense.REFERRING)
        source.end(int.from_bytes(known.digest[:4], "big"))
        block = _named(
            Block(
                digest=dense.block_digest(known.digest, data),
                streams=tuple(streams),
                single=_after(known.single, len(places) == 1),
                chances=tuple(
                    _after(chance, place in places) for place, chance in enumerate(known.chances)
                ),
                in_turn=in_turn,
            ),
            known,
            form,
            distance,
        )
        return samples, block

    def _samples(
        self,
        source: Source,
        places: Sequence[int],
        streams: list[tuple[State | None, Habit]],
        samples: list[tuple[int, dict[str, Any]]],
    ) -> int:
        distance, beside = 1, dict[int, Row]()
        for place in places:
            (last, habit), count, first = streams[place], 0, 1
            is_more = True
            while is_more:
                count += 1
                steps = 1
                if count > 1:
                    is_next = source.flag(habit.regular)
                    steps = 1 if is_next else 2 + source.shares(_STEPS[1:])
                    habit = replace(habit, regular=_after(habit.regular, is_next))
                elif last is not None:
                    first = steps = 1 + source.shares(habit.steps)
                    habit = habit.after_steps(steps)
                stream_id = self.ids[place]
                value, last = self.streams[place].read(source, stream_id, last, steps, beside)
                beside[stream_id] = last.row
                samples.append((stream_id, value))
                is_more = count < _MOST_SAMPLES and source.flag(habit.more[min(count, 12) - 1])
                if count < _MOST_SAMPLES:
                    habit = habit.after_more(count, is_more)
            streams[place] = last, habit
            distance = max(distance, -(-first // count))
        return distance

    def _hold(self, block: Block) -> None:
        if block.name is None:
            return
        held = self._held.get(block.name)
        if held is None or not block.is_outdated_by(held):
            self._held[block.name] = block

    def is_held(self, block: Block) -> bool:
        return block.name is not None and self._held.get(block.name) is block

    def write_alone(self, stream_id: int, value: Mapping[str, Any]) -> bytes:
        """Return a block of one sample, plainly (C.8)."""
        sink = Sink()
        sink.shares((28, 3, 1), dense.SINGLE)
        place = self.ids.index(stream_id)
        sink.one_of(len(self.ids), place)
        self.streams[place].write(sink, value)
        sink.shares((31, 1), 1)
        return sink.end(int.from_bytes(self.root.digest[:4], "big"))


def _places(source: Source, known: Block) -> list[int]:
    if source.flag(known.single):
        return [source.shares(known.chances)]
    return [place for place, chance in enumerate(known.chances) if source.flag(chance)]


def _form(source: Source, known: Block, *, refers: bool) -> tuple[int, int]:
    if not refers:
        return (0, 5)[source.shares((31, 1))], known.in_turn
    is_first = source.flag(known.in_turn)
    form = 0 if is_first else 1 + source.shares((16, 8, 4, 2, 2))
    return form, _after(known.in_turn, is_first)


def _named(block: Block, known: Block, form: int, distance: int) -> Block:
    place = int.from_bytes(block.digest[4:6], "big")
    ancestors: tuple[bytes, ...] = ()
    turn = place % 38
    if known.turn is not None:
        turn = (known.turn + distance) % 38
        ancestors = (known.digest, *known.ancestors[: _GENERATIONS - 1])
    name = (turn, *(38 + place % 6,) * 4, None)[form]
    return replace(block, name=name, turn=turn, ancestors=ancestors)


_AGE = "age of the sample"
_BYTES = "bytes without a type"


def of_table(table: Table, source: int) -> Reader:
    """Return the reader of a source's blocks, by a table without a model (section 7.3)."""
    types, names = dict(table.all_types), dict[int, str]()
    types[_BYTES] = (Field(_BYTES, "bytes"),)
    for stream_id, stream in table.streams.items():
        if not isinstance(stream, Topic) or stream.codec != "dense":
            continue
        if stream.publishers and source not in stream.publishers:
            continue
        names[stream_id] = stream.type or _BYTES
        if stream.aged:
            aged = f"{names[stream_id]} and an age"
            types[aged] = (*types[names[stream_id]], Field(_AGE, "uint8"))
            names[stream_id] = aged
    return Reader(types, names, describe.table_digest(table))


def parts_of(value: Mapping[str, Any]) -> tuple[Any, int | None]:
    """Return a sample of a block without its age code, and that."""
    plain = {name: each for name, each in value.items() if name not in (_AGE, _BYTES)}
    return value.get(_BYTES, plain), value.get(_AGE)
