"""A recording of a small trial, made by the command line."""

from pathlib import Path

import pytest

from tests.recording.smalltrial import CHANNEL, FLEET
from zacoustic.app.cli import main


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    """A recording that the command line has made."""
    (tmp_path / "water.json5").write_text(CHANNEL, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(FLEET, encoding="utf-8")
    path = tmp_path / "trial.mcap"
    assert (
        main(["sim", str(tmp_path / "water.json5"), "--until", "600", "--record", str(path)]) == 0
    )
    return path
