"""Make the recording of this version that later ones must read: before each release.

    python -m tests.recording.makeversion 1.2.3

`tests/recording/versions` keeps one of each released version, by its name. Without an argument it
is `unreleased`, for the time before the first. `test_versions.py` reads them all.
"""

import sys
import tempfile
from pathlib import Path
from typing import Final

from tests.recording.smalltrial import CHANNEL, FLEET
from zacoustic.app.cli import main

FOLDER: Final = Path(__file__).parent / "versions"
LENGTH_S: Final = 120


def make(name: str) -> Path:
    """Record two minutes of the small trial."""
    path = FOLDER / f"{name}.mcap"
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "fleet.json5").write_text(FLEET, encoding="utf-8")
        channel = Path(folder, "water.json5")
        channel.write_text(CHANNEL, encoding="utf-8")
        path.unlink(missing_ok=True)
        if main(["sim", str(channel), "--until", str(LENGTH_S), "--record", str(path)]):
            sys.exit("the trial failed")
    return path


if __name__ == "__main__":
    print(make(sys.argv[1] if sys.argv[1:] else "unreleased"))
