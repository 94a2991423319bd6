"""A vector that has changed is a changed wire: this test fails first, so that nobody overlooks it.

Section 20 of docs/wire.md says when the wire may change. `FROZEN` has the SHA-256 of each file of
vectors; who changes one on purpose puts its new digest here.
`python -m tests.golden.test_frozen` prints the digests as they are now.
"""

import hashlib
from pathlib import Path
from typing import Final

import pytest

from zacoustic.core.wire.agreement import WIRE_VERSION

FOLDER: Final = Path(__file__).parent
FROZEN: Final = {
    "arithmetic.json": "647bcc4f550c0444",
    "conversations/call.json": "9291fba34ba98a2c",
    "conversations/contact.json": "40dda4f63728aa83",
    "conversations/dense.json": "ffa332e15d68404e",
    "conversations/goal.json": "2c2da6a254af5dbf",
    "conversations/object.json": "83e74355796d4fde",
    "conversations/reliable.json": "11c4a106d6ec285c",
    "conversations/reliable_sealed.json": "340e661ba0a68c3b",
    "conversations/sealed.json": "2af87069b34fecf1",
    "conversations/tables.json": "717a59717c6ea3fb",
    "dense_frames.json": "4a50825a36bc486c",
    "ends.json": "38a4aafcb49ce36f",
    "edges.json": "e25fe665db1bf519",
    "objects.json": "fd68d9f916c323e4",
    "payload_cbor.json": "e67aa5cee3f3045f",
    "payload_packed.json": "9d10267ca6a2292e",
    "payload_refused.json": "b5998c8cd928cf97",
    "refusals.json": "48a24d9957e3d6b7",
    "tables.json": "23a6878b97d247a8",
    "wire_native.json": "ff854422425ed6b0",
    "wire_relayed.json": "1725f8a4b0febb65",
    "wire_sealed.json": "7677bd3dbd54735f",
}


def digests() -> dict[str, str]:
    """Return the digest of each file of vectors now, by its name."""
    files = [*FOLDER.glob("*.json"), *FOLDER.glob("conversations/*.json")]
    return {
        str(path.relative_to(FOLDER)): hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        for path in sorted(files)
    }


@pytest.mark.parametrize("name", sorted({*FROZEN, *digests()}))
def test_a_file_of_vectors_is_as_it_was(name: str) -> None:
    assert digests().get(name) == FROZEN.get(name), __doc__


def test_these_are_vectors_of_version_2() -> None:
    assert WIRE_VERSION == 2


if __name__ == "__main__":
    for file, digest in digests().items():
        print(f'    "{file}": "{digest}",')
