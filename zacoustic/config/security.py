"""The table `security`: the seal of frames.

This module does not read the key file: planning, decoding and watching need a fleet's
configuration, but no key. `zacoustic.seal.keyring` reads it where frames are made.
"""

from pathlib import Path

from zacoustic.config.problems import SECTION_PATH, Place
from zacoustic.config.sections import SecurityEntry
from zacoustic.core.base.qos import Reliability
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.seal.spec import Seals, SecuritySpec


def read_security(
    place: Place, entry: SecurityEntry | None, table: StreamTable, folder: Path
) -> SecuritySpec | None:
    """Read the table at `place`; None: there is none.

    Args:
        place: Place of the table.
        entry: Its content, or None.
        table: The streams.
        folder: Folder to which files are relative.

    Raises:
        ConfigError: A key is wrong; reports the first.
    """
    if entry is None:
        return None
    _check_lengths(place.at("pad"), entry.pad or ())
    unsealed = () if entry.emergency is None else entry.emergency.unsealed
    return SecuritySpec(
        source=f"{place.source}: {SECTION_PATH}{place.path}",
        key=place.at("key").path_of(entry.key, folder),
        lives=place.at("lives").path_of(entry.lives, folder),
        members=None
        if entry.members is None
        else place.at("members").path_of(entry.members, folder),
        mode=entry.mode,
        strong=frozenset(entry.strong),
        pad=entry.pad or (),
        overlap_s=entry.overlap_s,
        reply_share=entry.reply_share,
        only_opens=entry.seal is Seals.NONE,
        unsealed=_read_topics(place.at("emergency").at("unsealed"), unsealed, table),
    )


def seal_rules(security: SecuritySpec | None) -> SealRules:
    """Return the settings of the seal for an engine."""
    if security is None:
        return SealRules()
    return SealRules(
        strong=frozenset(each.value for each in security.strong),
        pad_bytes=security.pad,
        unsealed=security.unsealed,
        reply_share=security.reply_share,
    )


def _check_lengths(place: Place, lengths: tuple[int, ...]) -> None:
    for index, length in enumerate(lengths):
        if index and length <= lengths[index - 1]:
            place.at(index).refuse(
                f"{length} behind {lengths[index - 1]}", allowed="ascending, each length once"
            )


def _read_topics(place: Place, names: tuple[str, ...], table: StreamTable) -> frozenset[int]:
    topics = {
        each.name: each.stream_id
        for each in table
        if isinstance(each.spec, TopicSpec) and each.qos.reliability is Reliability.BEST_EFFORT
    }
    for index, name in enumerate(names):
        if name not in topics:
            place.at(index).refuse(
                f'"{name}" is no best-effort topic of streams',
                allowed=", ".join(topics) or "none, no such topic",
            )
    return frozenset(topics[name] for name in names)
