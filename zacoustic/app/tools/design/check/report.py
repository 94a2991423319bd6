"""A configuration as a table: the airtime of each stream, before the dive.

The bytes are those of a record alone in a frame, on a link that frames, addresses and checks by
itself: stream id, wildcards, age or call byte, payload. The airtime is that of such a frame with
the modem profile. docs/wire.md tells what else a frame may carry (HELLO, LEN, the envelope of a
poorer link).
"""

import os
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from zacoustic.app.tools.crossing import crosses_in_parts, room_bytes
from zacoustic.app.tools.design.check import desert
from zacoustic.app.tools.design.check.bits import SampleBits, sample_bits
from zacoustic.app.tools.design.sharenote import capabilities_like, share_notes
from zacoustic.channel.profiles import DEFAULT_PROFILE, ModemProfile, profile_named
from zacoustic.config import Config
from zacoustic.config.ros import RosConfig
from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.bond.spec import Bond, BondLink
from zacoustic.core.peers.agreementpolicy import TAGS_FROM_NODES, AgreementMethod
from zacoustic.core.profiles.rules import LinkRules
from zacoustic.core.relay.flood import FLOOD_NAME
from zacoustic.core.schedule.access import (
    AutoSpec,
    ClockedSpec,
    DelegatedSpec,
    PollingSpec,
    choice,
    choose,
)
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec, in_parts
from zacoustic.core.streams.table import Stream
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.payload import CborCodec, PayloadCodec, TypedCodec
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.errors import ConfigError, ZacousticError
from zacoustic.link import registry
from zacoustic.ros.qos import RosDurability
from zacoustic.ros.streams import RosTopic
from zacoustic.run.journal import journal_in
from zacoustic.run.journal.forgotten import forgotten
from zacoustic.text.safetext import without_secrets

_ID_BYTES = 1
_CALL_BYTES = 1
_STATUS_BYTES = 1
_DAY_NS = seconds_to_ns(24 * 3600)


class StreamRow(msgspec.Struct, frozen=True, kw_only=True):
    """One direction of one stream."""

    stream_id: int
    """1…175."""
    kind: str
    """`topic`, `request`, `response`, `goal`, `feedback` or `result`."""
    name: str
    """Key expression."""
    type: str | None
    """Name of the type; None: opaque bytes."""
    sources: tuple[int, ...] | None
    """Addresses that send it; None: any."""
    targets: tuple[int, ...] | None
    """Addresses that receive it; None: all."""
    priority: str
    """Zenoh's name."""
    depth: int | None
    """Samples stored per key; None: does not apply."""
    lifespan_s: float | None
    """Age above which it is not sent, s; for services and actions their timeout; None: no limit."""
    smallest_bytes: int
    """Smallest record, id included."""
    largest_bytes: int | None
    """Largest record, id included; None: unbounded."""
    airtime_s: float
    """Airtime of the largest record that fits a frame, alone in it, s."""
    bits: SampleBits | None = None
    """Cost of a sample in bits, if packed or dense."""


class TypeRow(msgspec.Struct, frozen=True, kw_only=True):
    """One type."""

    name: str
    """Its name."""
    fields: int
    """Number of its fields, without those of nested types."""
    smallest_bytes: int
    """Smallest payload."""
    largest_bytes: int | None
    """Largest payload; None: without a bound."""


class LinkRow(msgspec.Struct, frozen=True, kw_only=True):
    """One modem."""

    locator: str
    """Its locator in the file."""
    error: str
    """Why it is unusable on this computer; empty: it is usable."""
    mtu_bytes: int | None = None
    """Its largest frame, if known before it is open."""
    is_wrong: bool = False
    """No computer can use it: there is no such link, or its address or a setting is wrong."""


class _Built(msgspec.Struct, frozen=True):
    """A link that was created, and not opened."""

    row: LinkRow
    capabilities: LinkCapabilities | None
    """Its capabilities, if known before it is open."""


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """The result of `check` for a valid configuration."""

    file: str
    """The file."""
    address: int
    """Acoustic address of this node."""
    nodes: dict[int, str]
    """Name of each node by address."""
    links: tuple[LinkRow, ...]
    """The modems."""
    digest: str
    """Digest of the stream table: equal on both ends, otherwise typed streams stop."""
    wire: str
    """Wire profile of the link."""
    agreement: str
    """How nodes agree on tables; empty: frames are sealed, or are those of rmw_desert."""
    access: str
    """What "auto" chooses for medium access, and why; empty: the file names a method."""
    profile: str
    """Source of the airtimes: name of a modem profile, or locator of the link."""
    unsaid: str
    """Why the airtimes are not the link's; empty: they are, or a profile was given."""
    mtu_bytes: int
    """Largest frame of that modem."""
    streams: tuple[StreamRow, ...]
    """One row for a topic, two for a service, three for an action."""
    types: tuple[TypeRow, ...]
    """The types."""
    journal: str
    """File of the journal; empty: nothing survives a restart."""
    forgotten: str
    """What a restart forgets without a journal; empty: nothing relevant."""
    notes: tuple[str, ...]
    """Valid settings that deserve attention."""
    lost_contact: tuple[str, ...] = ()
    """What the gateway of this node does when it hears nobody, one line each."""
    misfits: tuple[str, ...] = ()
    """Streams that can never cross, each with a setting that would help."""


def report_of(config: Config, profile: ModemProfile | None) -> Report:
    """Make the report of a configuration.

    Args:
        config: The configuration.
        profile: Modem of the airtimes; None: the link's, or the default if the link has none.
    """
    on_desert = config.table.wire is WireProfile.RMW_DESERT
    built = [_build(entry.locator, config.address) for entry in config.links]
    links = tuple(each.row for each in built)
    unsaid = ""
    if profile is None:
        profile = profile_named(DEFAULT_PROFILE)
        if built and built[0].capabilities is not None:
            profile = _like(profile, built[0])
        elif built and not links[0].error:
            unsaid = f"{links[0].locator} reports its bit rate when it is open"
    unbounded_bytes = profile.mtu_bytes
    if not on_desert:
        profile = _bounded(profile, config.rules.of_links[0].max_frame_s)
        links = tuple(
            msgspec.structs.replace(row, mtu_bytes=_bounded_bytes(each.capabilities, own))
            for row, each, own in zip(links, built, config.rules.of_links, strict=False)
        )
    rows = tuple(
        row for stream in config.table for row in _rows(stream, profile, config.typical_bits)
    )
    return Report(
        file=config.source,
        address=config.address,
        nodes=config.nodes,
        links=links,
        digest=config.table.digest.hex(),
        wire=config.table.wire.value,
        agreement="" if on_desert or config.security else config.rules.agreement.value,
        access="" if on_desert else _access(config, profile, built),
        profile=profile.name,
        mtu_bytes=profile.mtu_bytes,
        streams=rows,
        types=tuple(
            _type_row(RmwDesertCodec(spec) if on_desert else CborCodec(spec))
            for spec in config.types
        ),
        journal=str(journal_in(config.journal, config.address).path) if config.journal else "",
        forgotten="" if config.journal else forgotten(config.table, config.address),
        unsaid=unsaid,
        lost_contact=tuple(_lost_contact(config)),
        notes=(
            *(() if on_desert else _channel_notes(config, built, profile, unbounded_bytes)),
            *_notes(config, links, rows, profile),
            *_price_notes(config, built, rows),
        ),
        misfits=() if on_desert else tuple(_misfits(config, rows, profile)),
    )


class _Direction(NamedTuple):
    """One direction of a stream."""

    kind: str
    type_name: str | None
    codec: PayloadCodec
    sources: tuple[int, ...] | None
    targets: tuple[int, ...] | None
    head_bytes: int
    lifespan_s: float | None


def _directions(stream: Stream) -> list[_Direction]:
    """Return one direction of a topic, two of a service, three of an action."""
    spec, codec, back = stream.spec, stream.codec, stream.response_codec
    head = desert.head_bytes(stream) if isinstance(codec, RmwDesertCodec) else None
    if isinstance(spec, TopicSpec):
        if head is None:
            head = _ID_BYTES + len(stream.keys.wildcards) + (stream.qos.stamp is Stamp.AGE)
        ends, lifespan_s = (spec.publishers, spec.subscribers), stream.qos.lifespan_s
        return [_Direction("topic", spec.type_name, codec, *ends, head, lifespan_s)]
    if head is None:
        head = _ID_BYTES + _CALL_BYTES
    here, there = (None, (spec.server,)), ((spec.server,), None)
    if isinstance(spec, ServiceSpec):
        limit_s = spec.timeout_s
        return [
            _Direction("request", spec.request_type, codec, *here, head, limit_s),
            _Direction("response", spec.response_type, back, *there, head, limit_s),
        ]
    result_head, limit_s = head + _STATUS_BYTES, spec.result_timeout_s
    feedback = stream.feedback_codec
    return [
        _Direction("goal", spec.goal_type, codec, *here, head, spec.timeout_s),
        _Direction("feedback", spec.feedback_type, feedback, *there, head, None),
        _Direction("result", spec.result_type, back, *there, result_head, limit_s),
    ]


def _rows(
    stream: Stream, profile: ModemProfile, typical: Mapping[int, float]
) -> Iterator[StreamRow]:
    for each in _directions(stream):
        largest = each.codec.largest_bytes
        largest_bytes = None if largest is None else each.head_bytes + largest
        frame_bytes = min(largest_bytes or profile.mtu_bytes, profile.mtu_bytes)
        yield StreamRow(
            stream_id=stream.stream_id,
            kind=each.kind,
            name=stream.name,
            type=each.type_name,
            sources=each.sources,
            targets=each.targets,
            priority=stream.qos.priority.name.lower(),
            depth=stream.qos.depth if each.kind == "topic" else None,
            lifespan_s=each.lifespan_s,
            smallest_bytes=each.head_bytes + each.codec.smallest_bytes,
            largest_bytes=largest_bytes,
            airtime_s=profile.airtime_s(frame_bytes),
            bits=sample_bits(stream, each.codec, typical),
        )


def _type_row(codec: TypedCodec) -> TypeRow:
    return TypeRow(
        name=codec.type_spec.name,
        fields=len(codec.type_spec.fields),
        smallest_bytes=codec.smallest_bytes,
        largest_bytes=codec.largest_bytes,
    )


def _like(profile: ModemProfile, built: _Built) -> ModemProfile:
    """Return a profile with the bit rate and the frame size of a link."""
    capabilities = built.capabilities
    assert capabilities is not None
    return msgspec.structs.replace(
        profile,
        name=built.row.locator,
        mtu_bytes=capabilities.mtu_bytes,
        preamble_s=capabilities.preamble_s,
        per_byte_s=8 / capabilities.bit_rate_bps,
        gap_s=capabilities.gap_s,
    )


def _bounded(profile: ModemProfile, max_frame_s: float | None) -> ModemProfile:
    """Return a profile whose frames have the airtime that the node allows."""
    if max_frame_s is None:
        return profile
    mtu_bytes = capabilities_like(profile).bounded(max_frame_s).mtu_bytes
    return msgspec.structs.replace(profile, mtu_bytes=mtu_bytes)


def _bounded_bytes(capabilities: LinkCapabilities | None, own: LinkRules) -> int | None:
    if capabilities is None or own.max_frame_s is None:
        return None if capabilities is None else capabilities.mtu_bytes
    return capabilities.bounded(own.max_frame_s).mtu_bytes


def _channel_notes(
    config: Config, built: Sequence[_Built], profile: ModemProfile, unbounded_bytes: int
) -> Iterator[str]:
    """Say what bounds a frame, and what this node leaves free for others."""
    own = config.rules.of_links[0]
    if profile.mtu_bytes < unbounded_bytes:
        yield (
            f"frames have at most {profile.mtu_bytes} of {unbounded_bytes} bytes, which take "
            f"{profile.airtime_s(profile.mtu_bytes):.1f} s: max_frame_s is {own.max_frame_s:g}"
        )
    capabilities = built[0].capabilities if built else None
    known = capabilities or capabilities_like(profile)
    yield from share_notes(known, own, len(config.nodes))


def _is_installed(locator: str) -> bool:
    return locator.partition("/")[0] in registry.names()


def _build(locator: str, address: int) -> _Built:
    """Create the link without opening it, to check its package and its settings."""
    shown = without_secrets(locator)
    try:
        link = registry.create(locator, address)
    except ZacousticError as error:
        is_wrong = isinstance(error, ConfigError) or not _is_installed(locator)
        row = LinkRow(locator=shown, error=without_secrets(error), is_wrong=is_wrong)
        return _Built(row, None)
    told = getattr(link, "capabilities", None)
    capabilities = told if isinstance(told, LinkCapabilities) else None
    mtu_bytes = None if capabilities is None else capabilities.mtu_bytes
    return _Built(LinkRow(locator=shown, error="", mtu_bytes=mtu_bytes), capabilities)


def _notes(
    config: Config, links: tuple[LinkRow, ...], rows: tuple[StreamRow, ...], profile: ModemProfile
) -> Iterator[str]:
    if config.table.wire is WireProfile.RMW_DESERT:
        yield from desert.notes(config.table)
    else:
        yield from _room_notes(config, rows, profile)
    for link in links:
        if link.mtu_bytes not in (None, profile.mtu_bytes):
            yield (
                f"{link.locator} takes frames of up to {link.mtu_bytes} bytes; sizes "
                f"and airtimes here are for up to {profile.mtu_bytes}"
            )
    if config.zenoh_config is None:
        yield "no Zenoh here (pip install eclipse-zenoh): its own keys are not checked"
    if not links:
        yield "no link: give one in the file (links: [ { locator } ]) or by --link"
    if not rows:
        yield "no streams: nothing crosses the channel"
    if config.journal is not None and not _is_writable(config.journal):
        yield f"journal: this user cannot write {config.journal}: the node would not start"
    yield from _agreement_notes(config)
    yield from _access_notes(config, profile)
    yield from _route_notes(config)
    yield from _bond_notes(config)
    yield from _flood_notes(config)
    yield from _carry_notes(config)
    yield from _lost_contact_notes(config)
    if config.ros is not None:
        ids = ", ".join(map(str, sorted(config.ros.streams)))
        yield f"ROS 2: {config.ros.distro}, domain {config.ros.domain}; streams {ids}"
        yield from _depth_notes(config.ros, rows)


def _depth_notes(ros: RosConfig, rows: tuple[StreamRow, ...]) -> Iterator[str]:
    """Say which topics of ROS keep one message only, where a node of ROS expects ten."""
    latest = [
        row
        for row in rows
        if row.depth == 1
        and isinstance(topic := ros.streams.get(row.stream_id), RosTopic)
        and topic.qos.durability is RosDurability.VOLATILE
    ]
    if latest:
        ids = ", ".join(str(row.stream_id) for row in latest)
        every_s = max(row.airtime_s for row in latest)
        yield (
            f"ROS 2 topics with depth 1 (a node's default is 10), streams {ids}: a newer message "
            f"replaces the one that waits, so of messages closer than {every_s:.2g} s, or than "
            "other traffic lets through, only the newest crosses; depth: 10 keeps ten"
        )


def _route_notes(config: Config) -> Iterator[str]:
    """Say where each route goes, and which streams name it."""
    for route in config.rules.routes:
        way = " - ".join(config.nodes.get(each, str(each)) for each in route.path)
        text = f"route {route.name}: {way}, {route.hops} hops over {route.link}"
        if route.other_end(config.address) is None:
            place = "a relay of it" if config.address in route.path else "not in it"
            yield f"{text}; node {config.address} is {place}"
            continue
        yield f"{text}; streams: {_streams_by(config, route.name) or 'none'}"
    if config.rules.routes:
        yield "zacoustic config plan counts a stream of a route once, not for each hop; sim runs it"


def _streams_by(config: Config, name: str) -> str:
    """Return the names of the streams that go by a link, a route or a list of links."""
    rules = config.rules
    return ", ".join(
        stream.name
        for stream in config.table
        if rules.links_of_streams.get(stream.stream_id, rules.default_link) == name
    )


def _flood_notes(config: Config) -> Iterator[str]:
    """Say which streams are flooded, and what one of their frames costs."""
    flood = config.rules.flood
    if flood is None:
        return
    names = _streams_by(config, FLOOD_NAME) or "no stream"
    yield (
        f"flood: {names}, {flood.hops} hops over {flood.link}: each node "
        f"in reach transmits such a frame once, and up to three times at the edge"
    )


def _carry_notes(config: Config) -> Iterator[str]:
    """Say who carries which topics, and how long."""

    def named(addresses: Iterable[int]) -> str:
        return ", ".join(config.nodes.get(each, str(each)) for each in addresses)

    for stream in config.table.carried:
        spec = stream.spec
        if not isinstance(spec, TopicSpec) or spec.carry is None:
            continue
        carry = spec.carry
        yield (
            f"{stream.name}: carried by {named(carry.by)} to {named(spec.subscribers or ())} where "
            f"these are not heard for {carry.after_s:g} s, for up to {carry.expires_s / 3600:g} h"
        )
        if config.address in carry.by:
            room = config.rules.carry_bytes
            yield f"this node carries {stream.name}: carry.max_bytes is {room} for all topics"


def _bond_notes(config: Config) -> Iterator[str]:
    """Say which links each list of links has, what they cost, and which streams name it."""
    rules = config.rules
    own = {each.name: each.bonded for each in rules.links}
    for bond in rules.bonds:
        costs = [
            f"{each} ({own[each].cost.value})" if each in own else f"{each} (not at this node)"
            for each in bond.links
        ]
        yield f"links {', '.join(costs)}; streams: {_streams_by(config, bond.name) or 'none'}"
        here = [own[each] for each in bond.links if each in own]
        if not here:
            yield f"links {', '.join(bond.links)}: none is at this node; its streams use the first"
        elif len(here) > 1 and not here[0].answers:
            yield (
                f"nothing answers on {bond.links[0]}, so it is only out of use after "
                f'{here[0].silence_s:g} s without a frame; cost: "free" if it is'
            )
        yield from _unanswered(config, bond, own)


def _price_notes(
    config: Config, built: Sequence[_Built], rows: tuple[StreamRow, ...]
) -> Iterator[str]:
    """Say what a sample costs on each link with a price: a byte more may cost another quantum."""
    rules = config.rules
    bonds = {bond.name: bond.links for bond in rules.bonds}
    for link, each in zip(rules.of_links, built, strict=False):
        tariff = link.bonded.tariff
        if tariff is None:
            continue
        for row in rows:
            by = rules.links_of_streams.get(row.stream_id, rules.default_link)
            goes_by = len(built) == 1 or link.name in (by, *bonds.get(by, ()))
            if not goes_by or row.largest_bytes is None:
                continue
            size = row.largest_bytes + _added_bytes(each.capabilities)
            quanta = -(-size // tariff.quantum)
            price = quanta * tariff.quantum * tariff.per_byte
            paid = f", paid for as {quanta} times {tariff.quantum}" if tariff.quantum > 1 else ""
            yield (
                f"{row.name} ({row.kind}) by {link.name}: up to {size} bytes alone in a frame"
                f"{paid}: {price:.4g}"
            )


def _added_bytes(capabilities: LinkCapabilities | None) -> int:
    """Return what the core adds to each frame of a link, bytes."""
    if capabilities is None:
        return 0
    return 2 * (not capabilities.addressed) + 4 * (not capabilities.checked)


def _unanswered(config: Config, bond: Bond, own: dict[str, BondLink]) -> Iterator[str]:
    """Say which streams would leave a link because nobody answers them."""
    silent = [each for each in bond.links[:-1] if each in own and not own[each].answers]
    if not silent or config.rules.contact.heartbeat_s is not None:
        return
    names = [
        stream.name
        for stream in config.table
        if config.rules.links_of_streams.get(stream.stream_id, config.rules.default_link)
        == bond.name
        and isinstance(stream.spec, TopicSpec)
        and config.address in (stream.spec.publishers or (config.address,))
        and stream.qos.reliability is Reliability.BEST_EFFORT
    ]
    if names:
        yield (
            f"nobody answers {', '.join(names)}, so a node that hears nothing else leaves "
            f"{silent[0]} for {bond.links[-1]} after {own[silent[0]].silence_s:g} s; with "
            "heartbeat_s at the other nodes it stays"
        )


def _lost_contact(config: Config) -> Iterator[str]:
    for each in config.lost_contact:
        nodes = " and ".join(
            f"{address} ({config.nodes[address]})" if address in config.nodes else str(address)
            for address in each.rule.nodes
        )
        doing = f"{'call' if each.is_call else 'publish'} {each.key}"
        yield (
            f"lost contact {each.rule.name}: {each.rule.lost_after_s:g} s without a frame of "
            f"{nodes or 'any other node'}: {doing}"
        )


def _lost_contact_notes(config: Config) -> Iterator[str]:
    if config.lost_contact and config.journal is None:
        yield (
            "lost_contact without a journal: a restart of the gateway begins the countdown anew, "
            "and a gateway that restarts all the time never acts"
        )
    longest_quiet_s = max((_length_s(each) for each in config.rules.quiet), default=0.0)
    for each in config.lost_contact:
        name, after_s = each.rule.name, each.rule.lost_after_s
        if each.heard_every_s is None:
            yield (
                f"lost contact {name}: none of its nodes has a heartbeat_s, so one that is there "
                f"and sends nothing for {after_s:g} s counts as lost"
            )
        if longest_quiet_s + (each.heard_every_s or 0.0) >= after_s:
            yield (
                f"lost contact {name}: quiet hours last {longest_quiet_s:g} s and do not stop the "
                f"countdown of {after_s:g} s: if the other nodes keep them too, this node acts in "
                "them"
            )


def _length_s(window: QuietWindow) -> float:
    return ns_to_seconds((window.ends_ns - window.begins_ns) % _DAY_NS)


def _misfits(config: Config, rows: tuple[StreamRow, ...], profile: ModemProfile) -> Iterator[str]:
    room = room_bytes(profile.mtu_bytes)
    for row in rows:
        if row.smallest_bytes <= room or crosses_in_parts(config.table.by_id(row.stream_id)):
            continue
        parts = in_parts(config.table.by_id(row.stream_id).spec)
        hint = parts if row.kind == "topic" else "make it smaller"
        yield (
            f"{_what(row)}: even its smallest record, {row.smallest_bytes} bytes, does not fit "
            f"the {room} bytes that a frame has for it: it never crosses ({hint})"
        )


def _room_notes(
    config: Config, rows: tuple[StreamRow, ...], profile: ModemProfile
) -> Iterator[str]:
    room = room_bytes(profile.mtu_bytes)
    for row in rows:
        parts = in_parts(config.table.by_id(row.stream_id).spec)
        hint = f" ({parts})" if row.kind == "topic" else ""
        if crosses_in_parts(config.table.by_id(row.stream_id)):
            if row.smallest_bytes > room:
                yield (
                    f"{_what(row)}: even its smallest record, {row.smallest_bytes} bytes, does "
                    f"not fit the {room} bytes that a frame has for it: all of it crosses in parts"
                )
        elif row.smallest_bytes > room:
            continue  # which is no note
        elif row.largest_bytes is None and row.type is not None:
            yield (
                f"{_what(row)}: {row.type} has no largest size; what does not fit the {room} "
                f"bytes of a frame is refused (give its texts and bytes a max_length){hint}"
            )
        elif row.largest_bytes is not None and row.largest_bytes > room:
            yield (
                f"{_what(row)}: up to {row.largest_bytes} bytes; what does not fit the {room} "
                f"bytes of a frame is refused{hint}"
            )


def _what(row: StreamRow) -> str:
    return f"stream {row.stream_id} ({row.name}), {row.kind}"


def _access(config: Config, profile: ModemProfile, built: Sequence[_Built]) -> str:
    """Say what "auto" chooses on the first link, or on one with such a modem, and why."""
    access = config.rules.access
    if access is not None and not isinstance(access, AutoSpec):
        return ""
    capabilities = built[0].capabilities if built else None
    like = f" with a modem like {profile.name}" if capabilities is None else ""
    method, why = choice(access, capabilities or capabilities_like(profile), config.address)
    return f'access "auto" is {method}{like}: {why}'


def _agreement_notes(config: Config) -> Iterator[str]:
    """Ask for agreement by tags where many nodes would confirm each other's frames."""
    nodes = len(config.nodes)
    confirms = config.rules.agreement is AgreementMethod.CONFIRM and config.security is None
    goes_to_all = any(
        isinstance(stream.spec, TopicSpec)
        and (stream.spec.subscribers is None or len(stream.spec.subscribers) > 1)
        for stream in config.table
    )
    if not (confirms and goes_to_all and nodes >= TAGS_FROM_NODES):
        return
    if config.table.wire is WireProfile.NATIVE:
        yield (
            f"agreement: {nodes} nodes confirm each other's frames by pairs, "
            f"{nodes * (nodes - 1)} times after a start of all; add agreement: "
            f'"{AgreementMethod.TAG.value}", better from {TAGS_FROM_NODES} nodes on'
        )


def _access_notes(config: Config, profile: ModemProfile) -> Iterator[str]:
    access = config.rules.access
    if access is None or isinstance(access, AutoSpec):
        return
    capabilities = capabilities_like(profile, controls_access=isinstance(access, DelegatedSpec))
    try:
        choose(access, capabilities, config.address, random.Random(1))
    except ConfigError as error:
        yield f"with a modem like {profile.name}: {error}"
    has_turn = True
    if isinstance(access, ClockedSpec):
        has_turn = access.has_slot(config.address)
    elif isinstance(access, PollingSpec):
        has_turn = config.address in {access.poller, *access.nodes}
    if not has_turn:
        yield f"access: node {config.address} has no turn in it, so it never transmits"


def _is_writable(folder: Path) -> bool:
    """Tell whether files can be made in a folder, which may not exist yet."""
    there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)
