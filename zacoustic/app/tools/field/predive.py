"""Before the dive: a strong frame in each direction through the real links, and a comparison.

Each other node is asked for its status, which is compared with that of this one: journal, clock,
medium access and range; its frames show table and life. Files (mode of the key, copies of the life
record, room on the disk) are known only to a node's own computer: the doctor examines them there.
"""

import asyncio
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.field.asking import Gateways, local_gateways
from zacoustic.app.tools.field.doctor.doctor import Options, diagnose
from zacoustic.app.tools.field.doctor.network import Running, look
from zacoustic.config import Config, read_config
from zacoustic.core.peers.sealing import SealRefusal
from zacoustic.core.schedule.access.spec import AutoSpec, ScheduleSpec, TdmaSpec
from zacoustic.errors import ConfigError, DeliveryError
from zacoustic.link.contract import Finding
from zacoustic.status.node import DroppedDocument
from zacoustic.status.peers import PeerRow
from zacoustic.status.table import document_in
from zacoustic.text.safetext import one_line
from zacoustic.zenoh.requests.ping import PING, PeerStatus, PingAnswer, PingAsked

DEFAULT_WITHIN_S: Final = 40.0
"""Time for answers, s; with the doctor's checks, a minute."""


_CLOCK_S: Final = 2.0
"""Synchronised clocks differ by less, s."""
_JOURNALS: Final = {
    "none": (
        "has no journal",
        "after a restart it may execute a call again that it has executed",
        "give it `journal`, a folder on its disk",
    ),
    "doubted": (
        "has a journal in doubt: damaged, or an old copy",
        "it may have forgotten what it accepted and executed before its restart",
        "look at its disk; put copies back only if zacoustic journal backup made them",
    ),
    "failing": (
        "cannot write its journal",
        "it accepts nothing that has to survive a restart",
        "make room on its disk, or give it a folder that can be written",
    ),
}
"""Fault, effect and cure."""


class Contact(msgspec.Struct, frozen=True, kw_only=True):
    """Another node, as seen from this one."""

    address: int
    """Its address."""
    name: str
    """Its name in `nodes`, or empty."""
    round_trip_s: float | None
    """Round-trip time of a remote command and its answer, s; None: no answer in time."""
    range_m: float | None
    """Its range, m; None: it cannot be measured."""
    life: int | None
    """Its boot epoch; if frames are sealed, its life."""
    same_table: bool | None
    """Whether it has this node's stream table; None: unknown."""
    status: PeerStatus | None
    """Its own status; None: unknown."""
    error: str
    """Why there was no answer, or empty."""


class PrediveReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result of `zacoustic predive`."""

    file: str
    """The configuration."""
    address: int
    """Address of this node."""
    sealed: bool
    """Frames are sealed, so an answer proves a member of the fleet."""
    took_s: float
    """Duration, s."""
    contacts: tuple[Contact, ...]
    """The other nodes."""
    findings: tuple[Finding, ...]
    """Faults, here and between the ends."""
    left_out: tuple[str, ...]
    """What was not examined, and why."""


async def predive(
    file: str | Path, options: Options, nodes: Sequence[int], within_s: float
) -> PrediveReport:
    """Test the channel to other nodes, and examine this one.

    Args:
        file: Its configuration.
        options: Options, as for the doctor.
        nodes: Addresses of the others; none: all of the file.
        within_s: Time for answers, s.

    Raises:
        ConfigError: The file is wrong, or there is no other node.
    """
    began_s = time.monotonic()
    config = read_config(file, address=options.address, locator=options.locator)
    others = _others(config, nodes)
    running, _ = await look(config, options.connect)
    answers: dict[int, PingAnswer | str] = {}
    findings: list[Finding] = []
    if running.health:
        answers = await _ask(config, options.connect, others, within_s)
        running, _ = await look(config, options.connect)  # again, after the exchange of frames
    else:
        findings.append(
            Finding(
                what=f"no gateway of node {config.address} runs here",
                why="nothing was tried on the channel",
                cure="start the gateway, and run predive on its network: --connect",
            )
        )
    contacts = tuple(_contact(config, running, each, answers.get(each)) for each in others)
    examined = await diagnose(file, options)
    findings += _of_contacts(config, running, contacts) if running.health else ()
    return PrediveReport(
        file=str(file),
        address=config.address,
        sealed=config.security is not None,
        took_s=round(time.monotonic() - began_s, 1),
        contacts=contacts,
        findings=(*findings, *examined.findings),
        left_out=(*examined.left_out, *_left_out(config)),
    )


def as_text(report: PrediveReport) -> str:
    """Return the report as lines."""
    lines = []
    for finding in report.findings:
        lines += [f"! {finding.what}", f"  at sea: {finding.why}", f"  cure:   {finding.cure}", ""]
    table = align(
        ("NODE", "ANSWER", "RANGE", "LIFE", "TABLE", "JOURNAL", "CLOCK"),
        [_cells(contact) for contact in report.contacts],
        right=("ANSWER", "RANGE", "LIFE"),
    )
    lines += [*table.split("\n"), ""]
    number = len(report.findings)
    verdict = f"{number} things are wrong" if number > 1 else "one thing is wrong"
    lines.append(
        f"{report.file}, node {report.address}: {verdict if number else 'nothing found'} "
        f"({report.took_s:g} s)"
    )
    lines += [f"not looked at: {each}" for each in report.left_out]
    return "\n".join(map(one_line, lines))


def _others(config: Config, nodes: Sequence[int]) -> list[int]:
    others = list(nodes) or [each for each in config.nodes if each != config.address]
    if not others:
        raise ConfigError(
            f"{config.source}: lists no other node; allowed: --node N", hint="or fill nodes"
        )
    for each in others:
        if each == config.address or (config.nodes and each not in config.nodes):
            listed = ", ".join(str(known) for known in config.nodes if known != config.address)
            raise ConfigError(f"--node {each}; allowed: {listed or 'another node'}")
    return others


async def _ask(
    config: Config, connect: Sequence[str], nodes: Sequence[int], within_s: float
) -> dict[int, PingAnswer | str]:
    """Return the answer of each node, or why there is none; one gateway asks all at once."""
    question = PingAsked(status=True)

    async def ask(gateways: Gateways, node: int) -> PingAnswer | str:
        try:
            return await gateways.ask(PING, node, question, within_s)
        except (DeliveryError, TimeoutError) as error:
            return str(error)

    async with local_gateways(config, connect or None) as gateways:
        answers = await asyncio.gather(*(ask(gateways, node) for node in nodes))
    return dict(zip(nodes, answers, strict=True))


def _contact(
    config: Config,
    running: Running,
    address: int,
    answer: PingAnswer | str | None,
) -> Contact:
    known = document_in(running.health, "peers", dict[int, PeerRow]).get(address, PeerRow())
    found = answer if isinstance(answer, PingAnswer) else None
    return Contact(
        address=address,
        name=config.nodes.get(address, ""),
        round_trip_s=None if found is None else found.round_trip_s,
        range_m=None if found is None else found.range_m,
        life=known.epoch,
        same_table=known.same_table,
        status=None if found is None else found.status,
        error=answer if isinstance(answer, str) else "" if found is not None else "not asked",
    )


def _of_contacts(
    config: Config, running: Running, contacts: Sequence[Contact]
) -> Iterator[Finding]:
    for contact in contacts:
        node = f"node {contact.address} {contact.name}".rstrip()
        if contact.round_trip_s is None:
            yield _unanswered(config, running, contact, node)
        there_m = None if contact.status is None else contact.status.range_m
        measured = (contact.range_m, there_m)
        farthest_m = max((each for each in measured if each is not None), default=None)
        guarded = _guarded(config, contact.address)
        if farthest_m is not None and guarded is not None and farthest_m > guarded.most_m:
            yield Finding(
                what=f"{node} is {farthest_m:.0f} m away; {guarded.key} is {guarded.most_m:g}",
                why="its frames arrive in the slots of others",
                cure=guarded.cure,
            )
        if contact.status is not None:
            yield from _of_status(config, contact.status, node)


class _Guarded(msgspec.Struct, frozen=True):
    """How far two nodes may be apart by the slots of the file."""

    key: str
    most_m: float
    cure: str


def _guarded(config: Config, address: int) -> _Guarded | None:
    """Return how far a node may be away; None: its slots and this node's are not neighbours."""
    access = config.rules.access
    if isinstance(access, TdmaSpec):
        if access.max_range_m is None:
            return None
        cure = "set max_range_m to the largest distance of the dive"
        return _Guarded("max_range_m", access.max_range_m, cure)
    schedule = access.schedule if isinstance(access, AutoSpec) else access
    if not isinstance(schedule, ScheduleSpec):
        return None
    found = []
    for index, slot in enumerate(schedule.slots):
        after = schedule.slots[(index + 1) % len(schedule.slots)]
        for first, second in ((slot.owners, after.owners), (after.owners, slot.owners)):
            if config.address in first and address in second:
                found.append((slot.range_m, index))
    if not found:
        return None
    most_m, index = min(found)
    cure = (
        "make the schedule again with the distances of the dive: zacoustic config plan --schedule"
    )
    return _Guarded(f"slots[{index}].range_m", most_m, cure)


def _unanswered(config: Config, running: Running, contact: Contact, node: str) -> Finding:
    refused = document_in(running.health, "dropped", DroppedDocument).channel
    seen = ""
    if config.security is not None:
        if refused.get(SealRefusal.FORGED.value):
            seen = f"; {refused[SealRefusal.FORGED.value]} frames came that this key does not open"
        elif refused.get(SealRefusal.UNSEALED.value):
            seen = f"; {refused[SealRefusal.UNSEALED.value]} frames came that are not sealed"
        elif contact.life is None:
            seen = "; no frame of it was ever heard"
    return Finding(
        what=f"{node} does not answer: {contact.error}{seen}",
        why="no command reaches it, and no stop",
        cure="see that its gateway runs, has the same key and generation, a life record, and may "
        "transmit: predive and zacoustic key check there; zacoustic monitor shows whether it is "
        "heard",
    )


def _of_status(config: Config, status: PeerStatus, node: str) -> Iterator[Finding]:
    if status.journal != "kept":
        what, why, cure = _JOURNALS[status.journal]
        yield Finding(what=f"{node} {what}", why=why, cure=cure)
    ahead_s, doubt_s = status.clock_ahead_s, status.clock_doubt_s
    if ahead_s is not None and doubt_s is not None:
        stated_s = config.rules.clock_error_s
        if abs(ahead_s) > doubt_s + max(stated_s, _CLOCK_S):
            word = "ahead of" if ahead_s > 0 else "behind"
            yield Finding(
                what=f"the clock of {node} is {abs(ahead_s):.0f} s {word} this one "
                f"(known to {doubt_s:.0f} s)",
                why="times of its samples are wrong here; slots and quiet hours are not the same",
                cure="set both clocks from one source: chrony, NTP or GPS",
            )
    if not status.same_schedule:
        yield Finding(
            what=f"{node} has other slots or turns, or none",
            why="one transmits in the slots or turns of the other",
            cure="give the links of both the same `access`",
        )


def _left_out(config: Config) -> Iterator[str]:
    yield "key files, life records and disks of other nodes: run predive there"
    if config.security is None:
        yield "who has answered: frames are not sealed, anybody can"


def _cells(contact: Contact) -> tuple[str, ...]:
    table = {True: "same", False: "another", None: "?"}[contact.same_table]
    status = contact.status
    return (
        f"{contact.address} {contact.name}".rstrip(),
        "none" if contact.round_trip_s is None else f"{contact.round_trip_s:.1f} s",
        "?" if contact.range_m is None else f"{contact.range_m:.0f} m",
        "?" if contact.life is None else str(contact.life),
        table,
        "?" if status is None else _journal_of(status),
        "?" if status is None or status.clock_ahead_s is None else f"{status.clock_ahead_s:+.0f} s",
    )


def _journal_of(status: PeerStatus) -> str:
    return f"{status.starts} starts" if status.journal == "kept" else status.journal
