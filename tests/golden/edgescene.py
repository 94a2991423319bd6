"""`Scene`: the dense blocks of one source, for `tests/golden/edges.json`.

Most blocks are the encoder's, each with the one before as its reference; where the encoder would
choose otherwise, it is made to choose.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final
from unittest.mock import patch

import msgspec

from tests.golden.dense import DIGEST
from tests.golden.fields import in_json
from tests.golden.tables import fields_of
from zacoustic.core.values.dense import DenseCodec, Listener, Model, Snapshot
from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model import habits
from zacoustic.core.values.dense.model.adaptation import StreamState
from zacoustic.core.values.dense.model.habits import Presence
from zacoustic.core.values.dense.stream import frame
from zacoustic.core.values.dense.stream.streamcodec import Beside, StreamCodec
from zacoustic.core.values.types import TypeSpec

STREAM: Final = 5
AGAINST, BY_MODEL, PLAINLY = 0, 1, 2

Value = Mapping[str, Any]


class Scene:
    """A source, and what a receiver reads of it.

    Args:
        types: Type of each dense stream.
        model: Their model.
        rounded: Whether values are given to six decimals.
    """

    def __init__(
        self, types: Mapping[int, TypeSpec], model: Model | None = None, *, rounded: bool = False
    ) -> None:
        self.codec: Any = DenseCodec(types, model=model, digest=DIGEST)
        self._types, self._model, self._rounded = types, model, rounded
        self._listener = Listener(self.codec)
        self._blocks: list[dict[str, Any]] = []

    def make(
        self,
        samples: Iterable[tuple[int, Value, int]],
        reference: Snapshot | None = None,
        *,
        name: int | None = None,
        form: int = 0,
        single: bool = False,
    ) -> tuple[bytes, Snapshot]:
        """Return a block and its snapshot.

        Args:
            samples: Stream, value, and steps since the sample before.
            reference: The block that it refers to.
            name: The name that it must have.
            form: The first form that it may have.
            single: Whether it is of kind 2.
        """
        forms = iter(range(form))
        lanes: dict[int, list[Any]] = {}
        known = self.codec._root if reference is None else reference
        ticks = [tick or 0 for _, tick, _ in known.streams]
        for stream_id, value, steps in samples:
            place = sorted(self._types).index(stream_id)
            ticks[place] += steps
            parts = self.codec.streams[stream_id].split(value)
            lanes.setdefault(place, []).append((place, ticks[place], parts))

        def refuses(found: Any) -> bool:
            if next(forms, None) is not None:
                return True
            return name is not None and bool(found.snapshot.name != name)

        aim = _aim(reference, refuses)
        if single:
            (piece,) = lanes.popitem()[1]
            encoded = self.codec._single(piece, aim)
        else:
            encoded = self.codec._several(lanes, aim)
        return encoded.frame, encoded.snapshot

    def hear(self, block: bytes) -> None:
        """Note what the receiver reads in a block."""
        decoded, mark = self._listener.decode(block), self._listener.mark
        samples = [[stream_id, in_json(value)] for stream_id, value in decoded.samples]
        self._blocks.append(
            {
                "block": block.hex(),
                "samples": _rounded(samples) if self._rounded else samples,
                "mark": None if mark is None else f"{mark:04x}",
            }
        )

    def say(
        self, samples: Iterable[tuple[int, Value, int]], reference: Snapshot | None = None
    ) -> Snapshot:
        """Make a block, and let the receiver read it."""
        block, snapshot = self.make(samples, reference)
        self.hear(block)
        return snapshot

    def chain(
        self, values: Sequence[Value], steps: Sequence[int] = (1,), last: Snapshot | None = None
    ) -> Snapshot:
        """Say a sample a block, each block with the one before as its reference."""
        for place, value in enumerate(values):
            last = self.say([(STREAM, value, steps[place % len(steps)])], last)
        assert last is not None
        return last

    def told(self, meaning: str) -> dict[str, Any]:
        """Return the scene as JSON."""
        inner = [each for spec in self._types.values() for each in spec.nested]
        types = {each.name: fields_of(each) for each in (*inner, *self._types.values())}
        found: dict[str, Any] = {
            "meaning": meaning,
            "table_digest": DIGEST.hex(),
            "types": list(types.values()),
            "streams": {str(stream_id): spec.name for stream_id, spec in self._types.items()},
        }
        if self._model is not None:
            text = msgspec.json.encode(self._model, order="sorted").decode()
            found |= {"model_text": text, "model_digest": self._model.digest.hex()}
        if self._rounded:
            found["rounded"] = True
        return {**found, "blocks": self._blocks}


def _aim(reference: Snapshot | None, refuses: Callable[[Any], bool]) -> Any:
    hidden: Any = frame
    return hidden._Aim(reference, refuses)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 6) + 0.0
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list) else value


@contextmanager
def mode(chosen: int) -> Iterator[None]:
    """Code each sample in one way, where it can be."""

    def write(
        self: Any,
        coder: Writer,
        parts: tuple[Any, Any],
        reference: StreamState | None,
        steps: int,
        beside: Beside,
    ) -> StreamState:
        way = chosen if reference is not None else max(chosen, BY_MODEL)
        found: StreamState = self._code(coder, way, *parts, reference, steps, beside)
        return found

    with patch.object(StreamCodec, "write", write):
        yield


@contextmanager
def never_single() -> Iterator[None]:
    """Say of each stream whether it is there, also of one alone."""

    def code(
        self: Presence, coder: Coder, places: Sequence[int]
    ) -> tuple[tuple[int, ...], Presence]:
        hidden: Any = habits
        coder.flag(self.single, False)
        found = tuple(n for n, each in enumerate(self.chances) if coder.flag(each, n in places))
        return found, hidden._presence_after(self, found)

    with patch.object(Presence, "code", code):
        yield
