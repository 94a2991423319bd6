"""Ways to damage a stream of frames and to cut it into pieces, drawn by Hypothesis."""

from collections.abc import Sequence

import msgspec
from hypothesis import strategies as st


class Damaged(msgspec.Struct, frozen=True):
    """What is left of some frames, and which of them nobody has touched."""

    stream: bytes
    untouched: tuple[int, ...]


@st.composite
def damaged(draw: st.DrawFn, frames: Sequence[bytes], alphabet: st.SearchStrategy[int]) -> Damaged:
    """Lose, truncate and garble some frames; put garbage between others; repeat some."""
    stream = b""
    untouched = []
    for number, frame in enumerate(frames):
        kind = draw(st.sampled_from(("whole", "whole", "whole", "lost", "head", "tail", "wrong")))
        at = draw(st.integers(1, len(frame) - 1))
        if draw(st.booleans()):
            stream += bytes(draw(st.lists(alphabet, max_size=40)))
        match kind:
            case "whole":
                untouched.append(number)
                stream += frame
            case "head":
                stream += frame[:at]
            case "tail":
                stream += frame[at:]
            case "wrong":
                stream += frame[:at] + bytes((draw(alphabet),)) + frame[at + 1 :]
            case _:
                pass
    return Damaged(stream, tuple(untouched))


def cut(stream: bytes, sizes: Sequence[int]) -> list[bytes]:
    """Cut a stream into pieces of these sizes, over and over."""
    pieces, place, turn = [], 0, 0
    while place < len(stream):
        size = sizes[turn % len(sizes)]
        pieces.append(stream[place : place + size])
        place, turn = place + size, turn + 1
    return pieces


def is_subsequence(few: Sequence[bytes], many: Sequence[bytes]) -> bool:
    """Whether all of `few` are in `many`, in this order."""
    rest = iter(many)
    return all(each in rest for each in few)


SIZES = st.lists(st.integers(1, 70), min_size=1, max_size=8)
BYTES = st.integers(0, 255)
