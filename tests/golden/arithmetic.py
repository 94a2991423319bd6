"""Makes the vectors of annexes A to C of docs/wire.md: `tests/golden/arithmetic.json`.

The texts that both ends know, digests of the tables, and examples symbol by symbol, as the real
reader takes them. After adding one: ``python -m tests.golden.arithmetic`` from the project's root.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from tests.golden.dense import DIGEST
from tests.golden.fields import in_json
from tests.golden.tables import fields_of, lines
from zacoustic.core.values.dense import DenseCodec, DenseSample, Listener, Snapshot, Speaker
from zacoustic.core.values.dense.coder import curve
from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.shares import ends_of
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model import sine
from zacoustic.core.values.dense.stream import packedbytes
from zacoustic.core.values.dense.text import text as textmodel
from zacoustic.core.values.dense.text.examples import payload_examples
from zacoustic.core.values.dense.text.lines import LINES
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.types import FieldSpec, TypeSpec

VECTORS: Final = Path(__file__).parent / "arithmetic.json"
TEXT: Final = b"leak 7"
DEEP: Final = TypeSpec(
    name="Deep",
    fields=(
        FieldSpec(name="depth", type="float64", range=(0, 100), step=0.5),
        FieldSpec(name="mode", type="enum", values=("idle", "survey", "abort")),
    ),
)
SAMPLES: Final = (
    {"depth": 12.5, "mode": "survey"},
    {"depth": 13.0, "mode": "survey"},
    {"depth": 13.5, "mode": "survey"},
    {"depth": 14.5, "mode": "abort"},
    {"depth": 14.5, "mode": "abort"},
)
"""The page shows how the first two are coded."""
STREAM: Final = 7
_FIRST_LISTED: Final = 32

Step = tuple[str, list[int], int, str, int]
"""A symbol: its kind, what it depends on, its value, the width after it, and the doublings."""


_KINDS: Final[dict[str, tuple[str, Callable[..., Sequence[int]]]]] = {
    "flag": ("flag", lambda probability: [probability]),
    "uniform": ("one of", lambda size: [size]),
    "raw": ("bits", lambda width: [width]),
    "choice": ("shares", lambda shares: shares),
    "pick": ("parts", lambda ends: ends[1:]),
    "near": ("curve", lambda *given: given),
}
"""By method of the reader: the word for its symbols, and what they depend on."""


class _Tracer:
    """Notes each symbol that readers take, but not those of which it consists."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._depth = 0

    def traced(self, name: str) -> Callable[..., Any]:
        """Return the method of that name, with a note of what it takes."""
        method: Callable[..., Any] = getattr(Reader, name)
        kind, of = _KINDS[name]

        def take(reader: Any, *given: Any) -> Any:
            given = given[: method.__code__.co_argcount - 2]
            self._depth += 1
            value = method(reader, *given)
            self._depth -= 1
            # One of one, and no bits, are not coded.
            if not self._depth and (kind, list(given)) not in (("one of", [1]), ("bits", [0])):
                width = f"{reader._width:012x}"
                self.steps.append((kind, list(of(*given)), int(value), width, reader.bits))
            return value

        return take


@contextmanager
def _traced() -> Iterator[list[Step]]:
    """Note the symbols of all blocks that are read meanwhile."""
    tracer = _Tracer()
    whole = {name: getattr(Reader, name) for name in _KINDS}
    for name in _KINDS:
        setattr(Reader, name, tracer.traced(name))
    try:
        yield tracer.steps
    finally:
        for name, method in whole.items():
            setattr(Reader, name, method)


def _text_example() -> dict[str, Any]:
    codec = packedbytes.PackedBytesCodec()
    block = codec.encode(TEXT)
    with _traced() as steps:
        assert codec.decode(block) == TEXT
    return {"text": TEXT.decode(), "block": block.hex(), "steps": steps}


def _dense_example() -> dict[str, Any]:
    codec = DenseCodec({STREAM: DEEP}, digest=DIGEST)
    speaker, listener, blocks = Speaker(codec), Listener(codec), []
    for tick, value in enumerate(SAMPLES):
        encoded = speaker.encode([DenseSample(STREAM, value, tick)], 64, {1})
        assert encoded is not None
        speaker.sent(encoded)
        with _traced() as steps:
            decoded = listener.decode(encoded.frame)
        assert listener.mark is not None
        speaker.acknowledged(1, listener.mark)
        blocks.append(
            {
                "block": encoded.frame.hex(),
                "value": in_json(decoded.samples[0][1]),
                "digest": decoded.snapshot.digest.hex(),
                "name": decoded.snapshot.name,
                "mark": f"{listener.mark:04x}",
                "steps": steps,
                "state": _state(codec, decoded.snapshot),
            }
        )
    return {
        "table_digest": DIGEST.hex(),
        "stream": STREAM,
        "type": fields_of(DEEP),
        "blocks": blocks,
    }


def _state(codec: DenseCodec, snapshot: Snapshot) -> dict[str, Any]:
    """Return all that the next block depends on."""
    state, _, habit = snapshot.streams[0]
    assert state is not None
    shape, presence = codec.streams[STREAM].model.shape, snapshot.presence
    return {
        "row": state.row,
        "velocity": state.velocity,
        "steadiness": state.steadiness,
        "adaptations": {
            str(place): {
                "weights": shape.unpacked(each.weights),
                "energies": each.energies,
                "log_scales": [manner[0] for manner in each.manners],
                "nearer": [manner[1] for manner in each.manners],
                "holds": [manner[2] for manner in each.manners],
                "widths": each.widths,
            }
            for place, each in state.adaptations.items()
        },
        "single": presence.single,
        "chances": list(presence.chances),
        "in_turn": presence.in_turn,
        "more": list(habit.more),
        "regular": habit.regular,
        "steps": list(habit.steps[0]),
    }


def _written(text: bytes) -> bytes:
    """Return the block of a text as it is, which may be no spelling."""
    content: Any = textmodel
    spell = content.spelled
    content.spelled = bytes
    try:
        writer = Writer()
        content.shipped_model().code(writer, text, (), None)
    except PayloadError:
        pass  # it reads what it has written
    finally:
        content.spelled = spell
    return writer.finish(1, 0)


def _next(block: bytes) -> bytes:
    return (int.from_bytes(block, "big") + 1).to_bytes(len(block), "big")


def _of_nothing(codec: DenseCodec) -> bytes:
    """Return an independent block without samples."""
    writer = Writer()
    writer.pick(ends_of(28, 3, 1), 1)
    writer.flag(1 << 15, False)
    writer.flag(1 << 15, False)
    writer.pick(ends_of(31, 1), 0)
    return writer.finish(1, codec.decode(_first(codec)).snapshot.check)


def _first(codec: DenseCodec) -> bytes:
    encoded = codec.encode([DenseSample(STREAM, SAMPLES[0], 0)], 64)
    assert encoded is not None
    return encoded.frame


def _refused_texts() -> dict[str, str]:
    codec = packedbytes.PackedBytesCodec()
    whole = codec.encode(TEXT)
    refused = {
        "a byte more than it takes": whole + b"\0",
        "another block that fits": _next(whole),
        "cut off": whole[:1],
        "digits that are not the shortest": _written(b"depth \xfb1.50\n"),
        "digits that are no number": _written(b"depth \xfbone\n"),
        "a float that is not spelled": _written(b"depth \xfb"),
        "1025 bytes": _written(b"leak" * 256 + b"!"),
    }
    for why, block in refused.items():
        if _is_read(codec, block):
            raise SystemExit(f"{why}: it is read")
    return {why: block.hex() for why, block in refused.items()}


def _refused_blocks() -> dict[str, str]:
    """Return blocks that the table of the example must refuse, without a block held."""
    codec = DenseCodec({STREAM: DEEP}, digest=DIGEST)
    other = DenseCodec({STREAM: DEEP}, digest=bytes(4))
    several = codec.encode([DenseSample(STREAM, each, n) for n, each in enumerate(SAMPLES)], 64)
    assert several is not None
    refused = {
        "a byte more than it takes": several.frame + b"\0",
        "another block that fits": _next(several.frame),
        "of another table": next(
            each.frame
            for depth in range(100)
            if (each := other.encode([DenseSample(STREAM, {**SAMPLES[0], "depth": depth})] * 2, 64))
            and not _is_read(codec, each.frame)
        ),
        "its reference is not held": bytes.fromhex(_dense_example()["blocks"][1]["block"]),
        "no sample": _of_nothing(codec),
    }
    for why, block in refused.items():
        if _is_read(codec, block):
            raise SystemExit(f"{why}: it is read")
    return {why: block.hex() for why, block in refused.items()}


def _is_read(codec: DenseCodec | packedbytes.PackedBytesCodec, block: bytes) -> bool:
    try:
        codec.decode(block)
    except PayloadError:
        return False
    return True


def digests() -> dict[str, str]:
    """Return the SHA-256 of tables: their numbers in decimal digits, each with a line feed."""
    lists = (
        each
        for _, _, positions in curve.CURVES[_FIRST_LISTED:]
        for sums in positions
        for each in sums
    )
    directions = (sine.direction(place, 4096)[1] for place in range(4096))
    return {
        "lists of the curves": _digest(lists),
        "scales of the grades": _digest(iter(curve.SCALES)),
        "sines": _digest(directions),
    }


def _digest(numbers: Iterator[int]) -> str:
    whole = hashlib.sha256()
    for each in numbers:
        whole.update(f"{each}\n".encode())
    return whole.hexdigest()


def known_texts() -> list[Any]:
    """Return the texts that both ends know; as hexadecimal digits where they are not printable."""
    texts = [*(line.encode() for line in LINES), *payload_examples()]
    return [_printable(text) or {"hex": text.hex()} for text in texts]


def _printable(text: bytes) -> str | None:
    try:
        found = text.decode()
    except UnicodeDecodeError:
        return None
    return found if found.isprintable() else None


def as_json() -> dict[str, Any]:
    """Return the content of the file."""
    return {
        "about": "Annexes A to C of docs/wire.md, made by tests/golden/arithmetic.py; a changed "
        "one is a changed wire. `texts`: those that both ends know, spelled. `digests`: SHA-256 of "
        "tables. `steps`: each symbol of an example: kind, what it depends on, value, w and D "
        "after it. `state`: what the next block depends on. `refused`: why, "
        "and the block: of a text, and of the table of the dense example with no block held.",
        "texts": known_texts(),
        "digests": digests(),
        "text": _text_example(),
        "dense": _dense_example(),
        "refused texts": _refused_texts(),
        "refused blocks": _refused_blocks(),
    }


def text() -> str:
    """Return the file."""
    return lines(as_json()) + "\n"


if __name__ == "__main__":
    VECTORS.write_text(text(), encoding="utf-8")
