"""Is the seal of a node in order: key file, life records, journal?"""

import os
from collections.abc import Iterator

import msgspec

from zacoustic.config import Config
from zacoustic.errors import ConfigError
from zacoustic.link.contract import Finding
from zacoustic.seal.keyring import Keyring, open_keyring
from zacoustic.text.safetext import one_line


class KeyCheck(msgspec.Struct, frozen=True, kw_only=True):
    """What was found."""

    file: str
    """The configuration."""
    address: int
    """Of the node."""
    network: str | None
    """Name of the network; None: no key could be read, here and below."""
    generation: int | None
    """Of the key."""
    fingerprint: str | None
    """Of the key."""
    life: int | None
    """Of the last start; None: there is no record, or none with this generation of the key."""
    findings: tuple[Finding, ...]
    """What is wrong."""


def check_keys(config: Config, fingerprint: str | None = None) -> KeyCheck:
    """Examine the seal of a node; nothing is changed.

    Args:
        config: Of the node.
        fingerprint: That of the key that it should have; None: any.
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
    if ring is not None:
        findings += _of_fingerprint(ring, fingerprint)
        findings += _of_lives(ring, config.address)
        findings += _of_journal(config)
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


def as_text(check: KeyCheck) -> str:
    """Return it as lines."""
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


def _of_fingerprint(ring: Keyring, wanted: str | None) -> Iterator[Finding]:
    if wanted is not None and wanted != ring.key.fingerprint:
        yield Finding(
            what=f"{ring.key.network}: the key has the fingerprint {ring.key.fingerprint}, "
            f"not {wanted}",
            why="this node and those with the other key do not open each other's frames",
            cure="put the present key file of the fleet on this computer",
        )


def _of_lives(ring: Keyring, address: int) -> Iterator[Finding]:
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


def _of_journal(config: Config) -> Iterator[Finding]:
    if config.journal is None:
        yield Finding(
            what=f"{config.source}: plugins.acoustic.journal: is missing",
            why="after a restart the node takes recorded frames of before for new ones",
            cure='name a folder: journal: "journal", or give --journal to the gateway',
        )
