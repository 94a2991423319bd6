"""Before the dive: a strong frame each way through the real links, and both ends compared.

What a node can see of the others is compared here: whether they answer, with which table, in which
life, how far away. What only their own computers know (their key file, life records, journal,
clock) the doctor examines there: run it on each.
"""

import asyncio
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.field.doctor.doctor import Options, diagnose
from zacoustic.app.tools.field.doctor.network import Running, look
from zacoustic.app.tools.field.pinging import GatewayPinger
from zacoustic.config import Config, read_config
from zacoustic.core.schedule.access.spec import TdmaSpec
from zacoustic.errors import ConfigError, DeliveryError
from zacoustic.link.contract import Finding
from zacoustic.text.safetext import one_line
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.session.session import ZenohSession

DEFAULT_WITHIN_S: Final = 40.0
"""How long answers are awaited, s; with what the doctor looks at, a minute."""


class Contact(msgspec.Struct, frozen=True, kw_only=True):
    """Another node, as this one has found it."""

    address: int
    """Which."""
    name: str
    """Its name in `nodes`, or empty."""
    round_trip_s: float | None
    """Of a remote command and its answer; None: no answer in time."""
    range_m: float | None
    """How far it is; None: nobody can measure it."""
    life: int | None
    """Its boot epoch; where frames are sealed, its life."""
    same_table: bool | None
    """It has this node's stream table; None: it has not said so."""
    error: str
    """Why there was no answer, or empty."""


class PrediveReport(msgspec.Struct, frozen=True, kw_only=True):
    """What was found."""

    file: str
    """The configuration."""
    address: int
    """Of this node."""
    sealed: bool
    """Frames are sealed: so an answer is one of the fleet."""
    took_s: float
    """All of it, s."""
    contacts: tuple[Contact, ...]
    """The other nodes."""
    findings: tuple[Finding, ...]
    """What is wrong, here and between the ends."""
    left_out: tuple[str, ...]
    """What was not looked at, and why."""


async def predive(
    file: str | Path, options: Options, nodes: Sequence[int], within_s: float
) -> PrediveReport:
    """Try the channel to other nodes, and examine this one.

    Args:
        file: Its configuration.
        options: As of the doctor.
        nodes: Addresses of the others; none: all of the file.
        within_s: How long answers are awaited, s.

    Raises:
        ConfigError: The file is wrong, or there is nobody to try.
    """
    began_s = time.monotonic()
    config = read_config(file, address=options.address, locator=options.locator)
    others = _others(config, nodes)
    running, _ = await look(config, options.connect)
    answers: dict[int, tuple[float | None, float | None, str]] = {}
    findings: list[Finding] = []
    if running.health:
        answers = await _ask(config, options.connect, others, within_s)
        running, _ = await look(config, options.connect)  # with what the frames have told
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
    findings += _of_contacts(config, contacts) if running.health else ()
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
        ("NODE", "ANSWER", "RANGE", "LIFE", "TABLE"),
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
) -> dict[int, tuple[float | None, float | None, str]]:
    """Return round trip, range and error of each node; all are asked at once, by one gateway."""
    zenoh_session = await ZenohSession.open(session_config(config, connect or None))
    pinger = GatewayPinger(zenoh_session)

    async def ask(node: int) -> tuple[float | None, float | None, str]:
        try:
            answer = await pinger.ping(node, within_s)
        except (DeliveryError, TimeoutError) as error:
            return None, None, str(error)
        return answer.round_trip_s, answer.range_m, ""

    try:
        return dict(zip(nodes, await asyncio.gather(*map(ask, nodes)), strict=True))
    finally:
        await zenoh_session.close()


def _contact(
    config: Config,
    running: Running,
    address: int,
    answer: tuple[float | None, float | None, str] | None,
) -> Contact:
    peers = running.health.get("peers")
    seen = peers.get(str(address)) if isinstance(peers, Mapping) else None
    known: Mapping[str, Any] = seen if isinstance(seen, Mapping) else {}
    round_trip_s, range_m, error = answer or (None, None, "not asked")
    return Contact(
        address=address,
        name=config.nodes.get(address, ""),
        round_trip_s=round_trip_s,
        range_m=range_m,
        life=known.get("epoch"),
        same_table=known.get("same_table"),
        error=error,
    )


def _of_contacts(config: Config, contacts: Sequence[Contact]) -> Iterator[Finding]:
    access = config.rules.access
    most_m = access.max_range_m if isinstance(access, TdmaSpec) else None
    for contact in contacts:
        node = f"node {contact.address} {contact.name}".rstrip()
        if contact.round_trip_s is None:
            yield Finding(
                what=f"{node} does not answer: {contact.error}",
                why="no command reaches it, and no stop",
                cure="see that its gateway runs, has the same key and file, and may transmit; "
                "zacoustic monitor shows whether it is heard",
            )
        if contact.range_m is not None and most_m is not None and contact.range_m > most_m:
            yield Finding(
                what=f"{node} is {contact.range_m:.0f} m away; max_range_m is {most_m:g}",
                why="its frames arrive in the slots of others",
                cure="set max_range_m to the largest distance of the dive",
            )


def _left_out(config: Config) -> Iterator[str]:
    yield "key file, life records, journal and clock of other nodes: run predive there"
    if config.security is None:
        yield "who has answered: frames are not sealed, anybody can"


def _cells(contact: Contact) -> tuple[str, ...]:
    table = {True: "same", False: "another", None: "?"}[contact.same_table]
    return (
        f"{contact.address} {contact.name}".rstrip(),
        "none" if contact.round_trip_s is None else f"{contact.round_trip_s:.1f} s",
        "?" if contact.range_m is None else f"{contact.range_m:.0f} m",
        "?" if contact.life is None else str(contact.life),
        table,
    )
