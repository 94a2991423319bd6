"""The permit log: a line for each emission, whatever the disk does."""

import asyncio
import json
import logging
from pathlib import Path

import pytest

from zacoustic.errors import ConfigError
from zacoustic.run.permitlog import Emission, PermitLog, emission, open_permit_log, utc_text

NEW_YEAR = 1_767_225_600_250_000_000


def line(frame_bytes: int) -> Emission:
    return emission(
        node=2,
        begun_utc_ns=NEW_YEAR,
        duration_ns=860_338_000,
        source_level_db=None,
        frame_bytes=frame_bytes,
        destination=255,
        outcome="sent",
    )


def written(path: Path) -> list[dict[str, object]]:
    return [json.loads(each) for each in path.read_text().splitlines()]


class _Ring(logging.Handler):
    """Sets an event of a loop for each record, from any thread."""

    def __init__(self, loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
        super().__init__()
        self._loop, self._event = loop, event

    def emit(self, record: logging.LogRecord) -> None:
        self._loop.call_soon_threadsafe(self._event.set)


def test_lines_are_appended_in_their_order(tmp_path: Path) -> None:
    path = tmp_path / "here" / "permit.jsonl"
    for life in range(2):
        log = PermitLog(path)
        for index in range(50):
            log.note(line(50 * life + index + 1))
        asyncio.run(log.close())
    assert [each["bytes"] for each in written(path)] == list(range(1, 101))
    assert written(path)[0] == {
        "utc": "2026-01-01T00:00:00.250Z",
        "node": 2,
        "duration_s": 0.860338,
        "source_level_db": None,
        "bytes": 1,
        "destination": 255,
        "outcome": "sent",
    }


def test_times_are_in_utc_with_milliseconds() -> None:
    assert utc_text(0) == "1970-01-01T00:00:00.000Z"
    assert utc_text(NEW_YEAR + 999_999) == "2026-01-01T00:00:00.250Z"


def test_file_that_cannot_be_opened_is_an_error_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"permit_log: .*: Is a directory"):
        open_permit_log(tmp_path)
    assert open_permit_log(None) is None


def test_lines_wait_while_the_file_cannot_be_written(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "permit.jsonl"
    log = PermitLog(path)

    async def scene() -> None:
        complained = asyncio.Event()
        handler = _Ring(asyncio.get_running_loop(), complained)
        logging.getLogger("zacoustic.run.linefile").addHandler(handler)
        path.unlink()
        path.mkdir()  # no file any more: as bad as a full disk
        log.note(line(1))
        log.note(line(2))
        await complained.wait()
        logging.getLogger("zacoustic.run.linefile").removeHandler(handler)
        path.rmdir()
        log.note(line(3))
        await log.close()

    with caplog.at_level(logging.WARNING):
        asyncio.run(scene())
    assert [each["bytes"] for each in written(path)] == [1, 2, 3]
    assert len(caplog.records) == 1
