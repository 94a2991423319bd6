"""The public facts about a key, without the key."""

from pathlib import Path

import msgspec

from zacoustic.seal.keys import FleetKey


class KeyReport(msgspec.Struct, frozen=True, kw_only=True):
    """The public facts about a key file."""

    file: str
    """Its name."""
    network: str
    """Name of the network."""
    generation: int
    """Generation of the key, counted from 0."""
    fingerprint: str
    """Eight hexadecimal digits, equal if the keys are."""
    opens_former: bool
    """Frames of the generation before are opened as well."""


def report_on(path: Path, key: FleetKey) -> KeyReport:
    """Return the public facts about a key file."""
    return KeyReport(
        file=str(path),
        network=key.network,
        generation=key.generation,
        fingerprint=key.fingerprint,
        opens_former=key.former is not None,
    )


def as_text(report: KeyReport) -> str:
    """Return the report as a line."""
    former = f", opens generation {report.generation - 1} too" if report.opens_former else ""
    return (
        f"{report.file}: network {report.network}, generation {report.generation}, "
        f"fingerprint {report.fingerprint}{former}"
    )
