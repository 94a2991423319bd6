"""The vector of an object of two blocks: makes `objects.json`.

Its fragments have one byte, so that there are more than 255 of them, and the manifest is in many.
"""

from pathlib import Path
from typing import Any, Final

from tests.golden.tables import lines
from zacoustic.core.transport.objects.code.code import Fragments
from zacoustic.core.transport.objects.manifest import encode_object

OBJECTS: Final = Path(__file__).parent / "objects.json"
FRAGMENT_BYTES: Final = 1
_REPAIR: Final = 8


def made() -> dict[str, Any]:
    """Return the content of the file."""
    payload = bytes(index * 7 % 256 for index in range(300))
    manifest, coded = encode_object(
        31, (2,), "text/plain", payload, lineage=0x1234, number=0x010203
    )
    fragments = Fragments(coded, FRAGMENT_BYTES)
    count = len(coded)
    repair = {
        str(index): fragments.fragment(index).hex() for index in range(count, count + _REPAIR)
    }
    return {
        "about": "An object of two blocks. `coded` is the manifest and the payload.",
        "stream": manifest.stream_id,
        "wildcards": list(manifest.instance),
        "encoding": manifest.encoding,
        "lineage": manifest.lineage,
        "number": manifest.number,
        "payload": payload.hex(),
        "digest": manifest.digest.hex(),
        "manifest_bytes": manifest.size_bytes,
        "coded": coded.hex(),
        "fragment_bytes": FRAGMENT_BYTES,
        "source_fragments": count,
        "blocks": -(-count // 255),
        "repair_fragments": repair,
    }


def text() -> str:
    """Return the file."""
    return lines(made()) + "\n"


if __name__ == "__main__":
    OBJECTS.write_text(text(), encoding="utf-8")
