"""The rows of a campaign on the disk: one line for each finished run.

The first line identifies the campaign by a digest of each part that decides a figure. Each further
line is a row, in the order in which the runs ended. Lines are appended and synced to the disk
before they are reported. A partial line after a crash is cut off at the next start, and its run is
repeated. One process at a time may use the file.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, Self

import msgspec

from zacoustic.app.tools.design.campaign.campaign import Campaign
from zacoustic.app.tools.design.campaign.running import Row
from zacoustic.errors import ConfigError
from zacoustic.run.filelock import lock_file

NAME: Final = "runs.jsonl"
"""Name of the file in the folder of the results."""
_PARTS: Final = {
    "version": "the version of zacoustic", "until_s": "until_s", "seeds": "seeds",
    "sweep": "sweep", "scenario": "the scenario", "configs": "the config",
    "files": "a file that is named",
}  # fmt: skip


class Head(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The first line."""

    campaign: dict[str, str]
    """Digest of each part, by name."""


class RowFile:
    """The file, locked while it is open; a context manager.

    Args:
        folder: Folder of the results; made if it is missing.
        campaign: The campaign of the rows.

    Raises:
        ConfigError: The folder has other contents or rows of another campaign, another process
            uses it, or it cannot be made.
    """

    def __init__(self, folder: Path, campaign: Campaign) -> None:
        self.path = folder / NAME
        """Path of the file."""
        self.rows: dict[int, Row] = {}
        """Rows by run."""
        self._campaign = campaign
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not self.path.exists() and any(folder.iterdir()):
                raise ConfigError(
                    f"{folder} has files and no {NAME}; allowed: a new folder, or one of results",
                    hint="give another name: --output FOLDER",
                )
            self._descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except (OSError, ValueError) as error:
            if isinstance(error, ConfigError):
                raise
            raise ConfigError(f"{self.path}: {getattr(error, 'strerror', error)}") from error
        try:
            self._begin()
        except BaseException:
            os.close(self._descriptor)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._descriptor)

    def append(self, rows: Sequence[Row]) -> None:
        """Append rows and sync them; a run that has a row keeps it.

        Raises:
            OSError: They cannot be written; none of them is stored then.
        """
        new = {row.run: row for row in rows if row.run not in self.rows}
        self._write(new.values())
        self.rows.update(new)

    def _begin(self) -> None:
        try:
            lock_file(self._descriptor)
        except OSError as error:
            raise ConfigError(
                f"{self.path} is in use; allowed: one process at a time",
                hint="wait for it, or --output FOLDER",
            ) from error
        content = self.path.read_bytes()
        head, *lines = content.split(b"\n")
        for line in lines[:-1]:  # the text after the last line end is incomplete
            row = _row_in(line, self._campaign.runs)
            if row is not None:
                self.rows.setdefault(row.run, row)
        if not lines or (not self.rows and _is_head(head)):
            self._check_is_ours(head)
            os.ftruncate(self._descriptor, 0)
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            self._write([Head(self._campaign.identity())])
            return
        self._compare(head)
        os.ftruncate(self._descriptor, content.rindex(b"\n") + 1)
        os.lseek(self._descriptor, 0, os.SEEK_END)

    def _check_is_ours(self, head: bytes) -> None:
        """Check that the file begins like our first line, which a crash may have cut."""
        whole = msgspec.json.encode(Head(self._campaign.identity()))
        beginning = whole[: whole.index(b"{", 1) + 1]
        if not (head.startswith(beginning) or beginning.startswith(head)):
            raise ConfigError(
                f"{self.path} is no file of rows; allowed: one that a campaign has made",
                hint="give another folder: --output FOLDER",
            )

    def _compare(self, head: bytes) -> None:
        try:
            written = msgspec.json.decode(head, type=Head).campaign
        except msgspec.MsgspecError:
            self._check_is_ours(b"?")
            return
        ours = self._campaign.identity()
        changed = [what for part, what in _PARTS.items() if written.get(part) != ours[part]]
        if changed:
            raise ConfigError(
                f"{self.path} has {len(self.rows)} runs of another campaign: changed since then: "
                f"{', '.join(changed)}; allowed: the same campaign",
                hint="take the change back to go on with them, or begin anew: --output FOLDER",
            )

    def _write(self, records: Iterable[msgspec.Struct]) -> None:
        text = b"".join(msgspec.json.encode(record) + b"\n" for record in records)
        end = os.lseek(self._descriptor, 0, os.SEEK_CUR)
        try:
            written = 0
            while written < len(text):
                written += os.write(self._descriptor, text[written:])
            os.fsync(self._descriptor)
        except BaseException:  # includes an interrupt: no part of a line stays
            os.ftruncate(self._descriptor, end)
            os.lseek(self._descriptor, end, os.SEEK_SET)
            raise


def _row_in(line: bytes, runs: int) -> Row | None:
    """Return the row of a line; None: it is not a row."""
    try:
        row = msgspec.json.decode(line, type=Row)
    except msgspec.MsgspecError:
        return None
    return row if 0 <= row.run < runs else None


def _is_head(line: bytes) -> bool:
    try:
        msgspec.json.decode(line, type=Head)
    except msgspec.MsgspecError:
        return False
    return True
