"""Findings from the health report of a running gateway."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from msgspec import UNSET

from zacoustic.app.tools.field.doctor.network import Running
from zacoustic.app.tools.watch.ways import is_poor, worst_hop
from zacoustic.config import Config
from zacoustic.core.bond.reach import Reach
from zacoustic.core.schedule.transmitter import UNHEARD_FRAMES
from zacoustic.link.contract import Finding
from zacoustic.status.link import BondDocument, LinkDocument, RelayDocument
from zacoustic.status.node import ContactDocument, DroppedDocument, JournalDocument
from zacoustic.status.peers import PeerRow
from zacoustic.status.streams import StreamsDocument
from zacoustic.status.table import document_in

_LEAST_AGAIN: Final = 10
_AGAIN_SHARE: Final = 0.1
"""A list of links of which more frames than this go again by the next link has a poor one."""
_LEAST_STRANGE: Final = 10
_LEAST_OWN: Final = 2
"""Least number of frames from the own address that damage does not explain."""


def judge(config: Config, running: Running) -> Iterator[Finding]:
    """Find faults in the documents of this node's gateway."""
    health = running.health
    link = document_in(health, "link", LinkDocument)
    if link.state not in ("unknown", "up"):
        yield Finding(
            what=f"the link of the running gateway is {link.state}: {link.detail}",
            why="nothing crosses while it is",
            cure="the text names the cause; the gateway continues by itself when it is gone",
        )
    if link.frames_heard == 0 and link.frames_sent >= UNHEARD_FRAMES:
        yield Finding(
            what=f"the running gateway has sent {link.frames_sent} frames and heard none",
            why="either nobody else is there, or this node is deaf, or nobody hears it",
            cure="see that another gateway runs on the same channel, that both transducers are in "
            "it, and that both links have the same settings",
        )
    if link.why_silent:
        yield Finding(
            what=f"the running gateway transmits nothing: {link.why_silent}",
            why="nothing of this node is heard while that holds",
            cure="zacoustic resume ends a commanded silence; a clock is set by chrony or NTP "
            "client, and the gateway notices it by itself",
        )
    yield from _clash(config, health)
    yield from _shared(config, health)
    yield from _tables(config, running)
    yield from _routes(health)
    for key in health:
        if key.startswith("bond/"):
            yield from _bond(key.removeprefix("bond/"), health)
        elif key.startswith("contact/"):
            yield from _lost_contact(key, document_in(health, key, ContactDocument))
    journal = document_in(health, "journal", JournalDocument)
    if journal.doubt:
        yield Finding(
            what=f"the journal of the running gateway is in doubt: {journal.doubt}",
            why="it may have forgotten what it accepted and executed before its restart",
            cure="look at the disk; put copies back only if zacoustic journal backup made them",
        )
    if journal.failure:
        yield Finding(
            what=f"the journal of the running gateway cannot be written: {journal.failure}",
            why="what is to survive a restart is refused: reliable topics with journal, calls",
            cure="make room on its disk, or give it a folder that can be written",
        )


def _clash(config: Config, health: Mapping[str, Any]) -> Iterator[Finding]:
    own = document_in(health, "dropped", DroppedDocument).channel.get("own", 0)
    if own >= _LEAST_OWN:
        yield Finding(
            what=f"address clash: {own} frames came with the address of node {config.address}, "
            "which is this one",
            why="each of the two ignores the other, and the rest of the fleet takes them for one: "
            "samples mix, acknowledgements go to the wrong one",
            cure="give each node an address of its own (address in the file, or --address)",
        )


def _shared(config: Config, health: Mapping[str, Any]) -> Iterator[Finding]:
    peers = document_in(health, "peers", dict[int, PeerRow])
    for address, peer in sorted(peers.items()):
        if address != config.address and peer.is_shared:
            yield Finding(
                what=f"address clash: two nodes have address {address}, their boot epochs take "
                "turns",
                why="this node takes the two for one: samples mix, acknowledgements go to the "
                "wrong one",
                cure="give each node an address of its own (address in its file, or --address)",
            )


def _tables(config: Config, running: Running) -> Iterator[Finding]:
    digest = config.table.digest.hex()
    others = [each for each in running.digests if each != digest]
    if others:
        yield Finding(
            what=f"table mismatch: the gateway that runs has table {', '.join(others)}, this file "
            f"is table {digest}",
            why="this file does not apply yet, and the other end may use it already",
            cure="restart the gateway with this file, or examine the file that it runs with",
        )
    peers = document_in(running.health, "peers", dict[int, PeerRow])
    mismatched = [str(each) for each in sorted(peers) if peers[each].same_table is False]
    if not mismatched:
        return
    differ = document_in(running.health, "streams", StreamsDocument).differ
    names = ", ".join(each.name for each in differ)
    yield Finding(
        what=f"table mismatch: node {', '.join(mismatched)} has another stream table"
        + (f"; streams that differ: {names}" if names else ""),
        why="streams that differ are stopped, all dense ones with them, and every frame says its "
        "table anew",
        cure="give both ends the same file; zacoustic config check shows the digest of a table",
    )


def _routes(health: Mapping[str, Any]) -> Iterator[Finding]:
    """Name the worst hop of the routes over this node, and a route that others have otherwise."""
    worst = worst_hop(
        each for each in document_in(health, "relay", RelayDocument).hops if is_poor(each)
    )
    if worst is not None:
        yield Finding(
            what=f"route {worst.route}: {worst.transmissions} transmissions to node "
            f"{worst.next_node} for {worst.passed_on} frames that arrived there, "
            f"{worst.given_up} given up",
            why="what goes over this hop comes late or not at all, and takes the channel of others",
            cure="bring the two nodes nearer to each other, or put another relay between them; "
            "see that the gateway there runs and has the same routes",
        )
    strange = document_in(health, "dropped", DroppedDocument).channel.get("relay_route", 0)
    if strange >= _LEAST_STRANGE:
        yield Finding(
            what=f"{strange} frames came of a route that this node's file lacks or has otherwise",
            why="a relay that has another path transmits nothing of it",
            cure="give all nodes the same routes",
        )


def _lost_contact(key: str, contact: ContactDocument) -> Iterator[Finding]:
    """Name an action at lost contact that nobody here would do."""
    if contact.served is not False:
        return
    nobody = f"nobody subscribes to {contact.publish}"
    if contact.call is not UNSET:
        nobody = f"nobody serves {contact.call}"
    yield Finding(
        what=f"lost_contact {key.removeprefix('contact/')}: {nobody} here",
        why="when contact is lost, nothing happens until somebody does",
        cure=f"start the program that acts, and look at its key: zacoustic monitor shows {key}",
    )


def _bond(name: str, health: Mapping[str, Any]) -> Iterator[Finding]:
    """Name a list of links without any that is up, or with a better link that reaches nobody."""
    bond = document_in(health, f"bond/{name}", BondDocument)
    if bond.links and bond.in_use is None:
        yield Finding(
            what=f"list of links {name}: none of {', '.join(bond.links)} is up",
            why="nothing of its streams crosses while that holds",
            cure="link/NAME of the health report says what each of them waits for",
        )
        return
    reach, again, sent = bond.reach.values(), bond.again, bond.frames_sent
    if not reach or sent < UNHEARD_FRAMES or again < max(_LEAST_AGAIN, sent * _AGAIN_SHARE):
        return
    for link in bond.links[:-1]:
        state = document_in(health, f"link/{link}", LinkDocument).state
        if state in ("unknown", "up") and all(each.get(link) is Reach.DOWN for each in reach):
            yield Finding(
                what=f"list of links {name}: {link} reaches none of {len(reach)} nodes, and "
                f"{again} of {sent} frames went again by the next link",
                why="frames come late while they wait for an answer there, and go by the link that "
                "costs more",
                cure=f"see that {link} has the same settings at all nodes and hears their answers; "
                "if it is only out of range, nothing is wrong",
            )
