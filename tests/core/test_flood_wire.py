"""The bytes of flooded frames: the vector of docs/wire.md, section 16, and anything else."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.pages.blocks import ROOT
from zacoustic.app.tools.inspect.decode.decoder import decode_frame
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.wire.flood import Flooded, decode, is_flooded
from zacoustic.core.wire.relay import decode as decode_relayed


def test_vector_of_the_page() -> None:
    encoded = bytes.fromhex("bf c0 01 ff 05 00 01 17")
    assert "| `bf c0 01 ff 05 00 01 17` |" in (ROOT / "docs/wire.md").read_text(encoding="utf-8")
    flooded = Flooded(1, BROADCAST, 5, 2, b"\x01\x17", 0)
    assert flooded.encode() == encoded
    assert decode(encoded) == flooded
    assert decode_relayed(encoded) is None
    said = decode_frame(encoded)
    assert (
        said[0].text
        == "RELAY 5, flooded by node 1 for all, 0 s old; 2 further nodes may pass it on"
    )
    assert said[1].kind == "record"


@given(
    st.integers(1, 254), st.integers(1, 255), st.integers(0, 255), st.integers(0, 3),
    st.binary(min_size=1, max_size=60),
)  # fmt: skip
def test_what_is_written_is_read(
    origin: int, destination: int, seq: int, left: int, content: bytes
) -> None:
    flooded = Flooded(origin, destination, seq, left, content)
    is_for_itself = origin == destination
    assert decode(flooded.encode()) == (None if is_for_itself else flooded)


@pytest.mark.parametrize(
    "wrong", ["bf 80", "bf 80 01 ff 05 00", "bf 81 01 ff 05 00 00", "bf 80 00 ff 05 00 00",
              "bf 80 ff 01 05 00 00", "bf 80 01 00 05 00 00", "b0 80 01 ff 05 00 00"],
)  # fmt: skip
def test_what_is_cut_off_or_of_nobody_is_refused(wrong: str) -> None:
    assert decode(bytes.fromhex(wrong)) is None


@given(st.binary(max_size=40))
def test_nothing_raises(content: bytes) -> None:
    decode(content)
    assert decode_frame(b"\xbf\x80" + content)
    assert is_flooded(b"\xbf\xe0")
