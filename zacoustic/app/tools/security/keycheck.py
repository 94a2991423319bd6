"""Checks the seal of a node: key file, life records, journal."""

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.config import Config
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.wire.envelope import Envelope
from zacoustic.core.wire.seal import LEAST_ROOM_BYTES
from zacoustic.errors import ConfigError
from zacoustic.link.contract import Finding
from zacoustic.run.journal import journal_in
from zacoustic.run.journal.inspection import inspect
from zacoustic.run.journal.lives import age_of, start_in
from zacoustic.run.journal.mark import read_mark
from zacoustic.seal.keyring import Keyring, open_keyring
from zacoustic.seal.lives import Lives
from zacoustic.status.node import EventsDocument, SealDocument
from zacoustic.status.table import document_in
from zacoustic.text.safetext import one_line
from zacoustic.zenoh.gateway.events.said import FORBIDDEN

_COUNTS: Final = re.compile(r" \([0-9]+\)")

_OLD: Final = (
    "frames of others that were recorded since then are opened once more; for some time after the "
    "start it refuses calls and goals that it may have executed"
)
_CURE: Final = "copies of a journal must not be put back; in doubt roll the key: docs/security.md"

Findings = Iterator[Finding]


class KeyCheck(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the check."""

    file: str
    """The configuration."""
    address: int
    """Address of the node."""
    network: str | None
    """Name of the network; None, here and below: no key could be read."""
    generation: int | None
    """Generation of the key."""
    fingerprint: str | None
    """Fingerprint of the key."""
    life: int | None
    """Life of the last start; None: no record, or none with this generation of the key."""
    findings: tuple[Finding, ...]
    """The faults."""


def check_keys(
    config: Config, fingerprint: str | None = None, *, is_running: bool = False
) -> KeyCheck:
    """Examine the seal of a node; nothing is changed.

    Args:
        config: Configuration of the node.
        fingerprint: Expected fingerprint of the key; None: any.
        is_running: Its gateway runs, and knows more of its journal than the files show.
    """
    ring: Keyring | None = None
    findings: list[Finding] = []
    life = None
    if config.security is None:
        findings.append(
            Finding(
                what=f"{config.source}: plugins.acoustic.security: is missing",
                why="everybody with a modem can read and command the fleet",
                cure="make a key with `zacoustic key new`, and name it there",
            )
        )
    else:
        try:
            ring = open_keyring(config.security, config.address)
        except ConfigError as error:
            findings.append(
                Finding(
                    what=str(error.args[0]),
                    why="the node does not start",
                    cure=error.hint or "put back a copy of the key file",
                )
            )
    if ring is not None and config.security is not None:
        findings += _of_fingerprint(ring, fingerprint)
        if not config.security.only_opens:
            findings += _of_lives(ring, config.address)
            findings += _of_journal(config, None if is_running else ring.lives)
        found = ring.lives.find()
        life = found.life if found.generation == ring.key.generation else None
    return KeyCheck(
        file=config.source,
        address=config.address,
        network=None if ring is None else ring.key.network,
        generation=None if ring is None else ring.key.generation,
        fingerprint=None if ring is None else ring.key.fingerprint,
        life=life,
        findings=tuple(findings),
    )


def check_room(config: Config, capabilities: LinkCapabilities) -> Findings:
    """Check that sealed frames fit a link, also with the lengths of `pad`.

    Args:
        config: Configuration of the node.
        capabilities: Capabilities of the link.
    """
    if config.security is None:
        return
    room_bytes = Envelope(capabilities, config.address, sealed=True).room_bytes
    if room_bytes < LEAST_ROOM_BYTES:
        yield Finding(
            what=f"the link has room for sealed frames of {room_bytes} bytes; allowed: at least "
            f"{LEAST_ROOM_BYTES}",
            why="head and tag take up to 13 bytes: the node does not use the link",
            cure="use another link, or leave security out and see what docs/security.md says then",
        )
    longest_bytes = max(config.security.pad, default=0)
    if longest_bytes > room_bytes:
        yield Finding(
            what=f"{config.source}: plugins.acoustic.security.pad: {longest_bytes}; the link has "
            f"room for sealed frames of {room_bytes} bytes",
            why="the node does not use the link",
            cure=f"make the longest one {room_bytes}",
        )


def check_running(config: Config, health: Mapping[str, Any], fingerprint: str | None) -> Findings:
    """Find faults in a running gateway's report on its seal.

    Args:
        config: Configuration of the node.
        health: Documents of the gateway, by name.
        fingerprint: Fingerprint of the key file here; None: unknown.
    """
    seal = document_in(health, "seal", SealDocument)
    if "seal" not in health:
        if config.security is not None:
            yield Finding(
                what="the running gateway does not seal its frames, and this file configures it",
                why="nobody with a key accepts its frames, and it executes anybody's commands",
                cure="restart the gateway with this file",
            )
        return
    if config.security is None:
        yield Finding(
            what="the running gateway seals its frames, and this file does not say so",
            why="after its next start nobody with a key accepts its frames",
            cure="see which of the two files is right",
        )
    elif fingerprint is not None and seal.fingerprint != fingerprint:
        yield Finding(
            what=f"the running gateway has the key {seal.fingerprint}, generation "
            f"{seal.generation}; the key file has {fingerprint}",
            why="the key file does not apply yet",
            cure="restart the gateway, or put back the key file that it runs with",
        )
    if seal.failure:
        yield Finding(
            what=f"the running gateway seals no frame: {seal.failure}",
            why="it transmits nothing",
            cure="zacoustic key check FILE names what is missing",
        )
    events = document_in(health, "events", EventsDocument).events
    texts = [each.text for each in events if each.event == "seal"]
    for text in dict.fromkeys(_COUNTS.sub("", each) for each in texts):
        if FORBIDDEN in text:
            yield Finding(
                what=f"refused records of a node of the fleet: {text}",
                why="the program of that node is changed, or somebody has its key",
                cure="look at that node; in doubt give the next key to all but that one",
            )
            continue
        yield Finding(
            what=f"the running gateway has refused frames: {text}",
            why="one end has another key, another generation or none; or somebody lies",
            cure="compare `zacoustic key show` of both ends",
        )


def as_text(check: KeyCheck) -> str:
    """Return the result as lines."""
    lines = []
    for finding in check.findings:
        lines += [f"! {finding.what}", f"  at sea: {finding.why}", f"  cure:   {finding.cure}"]
    if check.network is not None:
        life = "none yet with this key" if check.life is None else str(check.life)
        lines.append(
            f"{check.file}, node {check.address}: network {check.network}, generation "
            f"{check.generation}, fingerprint {check.fingerprint}, last life {life}"
        )
    if not check.findings:
        lines.append("nothing found")
    return "\n".join(map(one_line, lines))


def _of_fingerprint(ring: Keyring, wanted: str | None) -> Findings:
    if wanted is not None and wanted != ring.key.fingerprint:
        yield Finding(
            what=f"{ring.key.network}: the key has the fingerprint {ring.key.fingerprint}, "
            f"not {wanted}",
            why="this node and those with the other key do not open each other's frames",
            cure="put the present key file of the fleet on this computer",
        )


def _of_lives(ring: Keyring, address: int) -> Findings:
    found = ring.lives.find()
    folder = ring.lives.paths[0].parent
    if found.generation is None:
        yield Finding(
            what=f"{folder}: no record of the lives of node {address}",
            why="nobody knows which numbers are used up: the node opens frames and transmits none",
            cure=f"zacoustic key rejoin {address} --config FILE explains how to go on",
        )
    elif found.generation > ring.key.generation:
        yield Finding(
            what=f"{folder}: node {address} has started with generation {found.generation} of the "
            f"key, and the key file has {ring.key.generation}",
            why="an old copy of the key file was put back: the node transmits nothing",
            cure="put the present key file of the fleet on this computer",
        )
    elif found.faults:
        yield Finding(
            what="; ".join(found.faults),
            why="the next start mends it from the other copies, while one of them is left",
            cure="start the node; if it comes again, replace the disk",
        )
    there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
    if not os.access(there, os.W_OK | os.X_OK):
        yield Finding(
            what=f"{folder}: this user cannot write the life records",
            why="a node that cannot write down its life transmits nothing",
            cure="give the folder to the user of the gateway, or name another: security.lives",
        )


def _of_journal(config: Config, lives: Lives | None) -> Findings:
    if config.journal is not None and lives is not None:
        yield from _of_age(journal_in(config.journal, config.address).path, lives)
    if config.journal is None:
        yield Finding(
            what=f"{config.source}: plugins.acoustic.journal: is missing",
            why="after a restart the node takes recorded frames of before for new ones",
            cure='name a folder: journal: "journal", or give --journal to the gateway',
        )


def _of_age(path: Path, lives: Lives) -> Findings:
    """Compare the journal with the life records: either can reveal the other as an old copy."""
    try:
        found = inspect(path, None, read_mark(path))
    except OSError:
        return  # the doctor reports whether it can be read and written
    if found.fault:
        return  # the next start renames it, and reports that
    started, last = start_in(found.entries, lives), lives.find().last
    if age := age_of(started, lives):
        yield Finding(what=f"old journal: {path}: {age}", why=_OLD, cure=_CURE)
    elif started is not None and last is not None and started.life and started > last.next:
        yield Finding(
            what=f"old life records: {path} is of life {started.life}, and the records are of "
            f"life {last.life}",
            why="the next start goes on behind the journal; were that old, too, numbers would be "
            "used twice",
            cure="leave the folder of life records out of backups",
        )
