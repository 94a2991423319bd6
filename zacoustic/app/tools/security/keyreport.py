"""The public facts about a key, without the key; and those about a list of members."""

from pathlib import Path
from typing import Any

import msgspec

from zacoustic.seal.identities import Members
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
    """Eight hexadecimal digits, equal if the keys are; of a list, if its members are, too."""
    opens_former: bool
    """Frames of the generation before are opened as well."""


class MembersReport(KeyReport, frozen=True, kw_only=True):
    """The public facts about a members file."""

    members: tuple[int, ...]
    """Addresses of the members."""
    unheard: tuple[int, ...]
    """Nodes whose broadcast key some member lacks."""


def report_on(path: Path, key: FleetKey | Members) -> KeyReport:
    """Return the public facts about the file of a key, or of members."""
    facts: dict[str, Any] = {
        "file": str(path),
        "network": key.network,
        "generation": key.generation,
        "fingerprint": key.fingerprint,
        "opens_former": key.former is not None,
    }
    if isinstance(key, FleetKey):
        return KeyReport(**facts)
    listed = sorted(key.public)
    unheard = [
        source
        for source in listed
        if any(each not in key.wrapped.get(source, {}) for each in listed if each != source)
    ]
    return MembersReport(**facts, members=tuple(listed), unheard=tuple(unheard))


def as_text(report: KeyReport) -> str:
    """Return the report as lines."""
    former = f", opens generation {report.generation - 1} too" if report.opens_former else ""
    lines = [
        f"{report.file}: network {report.network}, generation {report.generation}, "
        f"fingerprint {report.fingerprint}{former}"
    ]
    if isinstance(report, MembersReport):
        lines.append(f"members: {', '.join(map(str, report.members)) or 'none'}")
        if report.unheard:
            nodes = ", ".join(map(str, report.unheard))
            what = f"not everybody opens broadcasts of node {nodes}"
            lines.append(f"{what}: its identity is not here")
    return "\n".join(lines)
