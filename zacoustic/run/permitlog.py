"""The permit log: every emission of a node, appended to a file.

A holder of a permit to transmit (a marine reserve, a range, an exercise) has to prove afterwards
when, how loud and how long each emission was. One JSON object per line::

    {"utc": "2026-01-01T12:00:03.250Z", "node": 2, "duration_s": 0.86, "source_level_db": 184.0,
     "bytes": 64, "destination": 255, "outcome": "sent"}

`utc` is the beginning. `source_level_db` is dB re 1 µPa at 1 m, null if the modem does not report
it. `link` is the name of the link if the node has several. ``"utc_in_doubt": true`` marks a `utc`
of a clock that nothing synchronises. `outcome` is ``sent``, ``delivered``, ``not_delivered`` or
``aborted``; an aborted emission may have been cut short. A ``rejected`` transmission made no sound
and is not in the log.

A file that cannot be opened is an error at the start; see `zacoustic.run.linefile`.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from zacoustic.core.base.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.base.linktypes import Transmission, TransmitOutcome, TransmitReport
from zacoustic.errors import ConfigError
from zacoustic.run.linefile import LineFile

if TYPE_CHECKING:
    from zacoustic.core.engine.engine import Engine


class Emission(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line."""

    utc: str
    """Beginning, UTC."""
    node: int
    """Address of the node."""
    duration_s: float
    """Duration of the sound, s."""
    source_level_db: float | None
    """Source level, dB re 1 µPa at 1 m."""
    bytes: int
    """Length of the frame."""
    destination: int
    """Address; 255: broadcast."""
    outcome: str
    """Outcome of the transmission."""
    link: str = ""
    """Name of the link, if the node has several."""
    utc_in_doubt: bool = False
    """Nothing synchronised the clock."""


class PermitLog:
    """The file and its thread.

    Args:
        path: The file; made with its folder if it is missing.

    Raises:
        ConfigError: It cannot be appended to.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = LineFile(path, "permit log")
        except OSError as error:
            raise ConfigError(
                f"permit_log: {path}: {error.strerror}", hint="name a file that can be written"
            ) from error

    def note(self, emission: Emission) -> None:
        """Append an emission; does not block."""
        self._file.append(msgspec.json.encode(emission))

    def note_report(
        self, engine: "Engine", sent: Transmission, report: TransmitReport, offset_ns: int
    ) -> None:
        """Append the emission that a link reports, unless it made no sound.

        Args:
            engine: The engine of the transmission.
            sent: The transmission.
            report: Its report.
            offset_ns: UTC less the clock of the report, ns.
        """
        if report.outcome is TransmitOutcome.REJECTED:
            return
        modem = engine.measurements.modems.get(sent.link)
        self.note(
            emission(
                node=engine.address,
                begun_utc_ns=report.started_at + offset_ns,
                duration_ns=report.finished_at - report.started_at,
                source_level_db=None if modem is None else modem.source_level_db,
                frame_bytes=len(sent.frame_bytes),
                destination=sent.destination,
                outcome=report.outcome.value,
                link=sent.link if len(engine.links) > 1 else "",
                utc_in_doubt=not engine.clock.is_sure,
            )
        )

    async def close(self) -> None:
        """Write the waiting lines and end the thread."""
        await self._file.close()


def utc_text(utc_ns: int) -> str:
    """Return a time as ISO 8601 with milliseconds, such as ``2026-01-01T12:00:03.250Z``."""
    moment = datetime.fromtimestamp(utc_ns // NS_PER_S, UTC)
    milliseconds = utc_ns % NS_PER_S * 1000 // NS_PER_S
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{milliseconds:03d}Z"


def emission(
    *,
    node: int,
    begun_utc_ns: int,
    duration_ns: int,
    source_level_db: float | None,
    frame_bytes: int,
    destination: int,
    outcome: str,
    link: str = "",
    utc_in_doubt: bool = False,
) -> Emission:
    """Make the log line of an emission that began at a UTC time, ns since 1970."""
    return Emission(
        utc=utc_text(begun_utc_ns),
        node=node,
        duration_s=round(ns_to_seconds(duration_ns), 6),
        source_level_db=source_level_db,
        bytes=frame_bytes,
        destination=destination,
        outcome=outcome,
        link=link,
        utc_in_doubt=utc_in_doubt,
    )


def open_permit_log(path: Path | None) -> PermitLog | None:
    """Open the permit log that a config names, if any.

    Raises:
        ConfigError: It cannot be appended to.
    """
    return None if path is None else PermitLog(path)
