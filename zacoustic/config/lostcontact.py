"""The list `lost_contact`: what a gateway does when its node hears nobody any more.

A safety function must not depend on defaults that a reader overlooks, and must not fail when it is
needed: whatever can be checked beforehand is refused here.
"""

from collections.abc import Container

import msgspec

from zacoustic.config.problems import Place
from zacoustic.config.sections import LostContactEntry, NodeEntry, Section
from zacoustic.core.peers.contact import LEAST_MISSED
from zacoustic.core.peers.lostcontact import LostContactRule
from zacoustic.core.streams.keys import fault_of_name
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.encoding import CBOR, encode_application
from zacoustic.errors import PayloadInvalidError, ZacousticError


class LostContactAction(msgspec.Struct, frozen=True, kw_only=True):
    """A rule of this node and its action on the local Zenoh network."""

    rule: LostContactRule
    """When it acts."""
    key: str
    """Key of the service that is called, or of the sample that is put."""
    is_call: bool
    """Whether it is a call; otherwise a put."""
    value: object = None
    """Its value; None: an empty payload."""
    payload: bytes = b""
    """The encoded value, unless the service is a stream, which has its own encoding."""
    encoding: str
    """Encoding of `payload`."""
    stream_id: int | None = None
    """The service stream with that key, which this node serves; None: the key is no stream's."""
    is_ros: bool = False
    """Whether that stream is a service of ROS 2."""
    heard_every_s: float | None = None
    """The shortest heartbeat of the nodes that are contact, s; None: none sends any, or the file
    does not list the nodes."""
    timeout_s: float
    """How long to wait for the answer to a call before the next one, s."""


def read_lost_contact(
    place: Place,
    written: Section,
    own: int,
    table: StreamTable,
    ros_streams: Container[int],
) -> tuple[LostContactAction, ...]:
    """Read the list at `place`; return the entries of this node.

    Args:
        place: Place of the list.
        written: The section.
        own: Address of this node.
        table: The streams.
        ros_streams: Ids of those of ROS 2.

    Raises:
        ConfigError: An entry is wrong, whichever node it is for; reports the first.
    """
    actions = []
    for index, entry in enumerate(written.lost_contact):
        here = place.at(index)
        by = own if entry.by is None else entry.by
        _check_nodes(here, entry, by)
        _check_time(here, entry, by, written)
        action = _read_action(here, entry, by, table, ros_streams)
        beats = _heartbeats(entry.of, by, written)
        action = msgspec.structs.replace(action, heard_every_s=min(beats, default=None))
        if by == own:
            actions.append(action)
    return tuple(actions)


def _check_nodes(place: Place, entry: LostContactEntry, by: int) -> None:
    for index, address in enumerate(entry.of or ()):
        if address == by:
            place.at("of").at(index).refuse(
                f"{address} is the node that acts",
                allowed="another node",
                hint="say who acts, so that one file serves a fleet: by: ADDRESS"
                if entry.by is None
                else "",
            )


def _check_time(place: Place, entry: LostContactEntry, by: int, written: Section) -> None:
    """Check that the node does not act between two heartbeats of nodes that are there."""
    beats = _heartbeats(entry.of, by, written)
    if beats and entry.lost_after_s < LEAST_MISSED * min(beats):
        place.at("lost_after_s").refuse(
            f"{entry.lost_after_s:g} with heartbeat_s {min(beats):g}",
            allowed=f"{LEAST_MISSED * min(beats):g} or more, twice heartbeat_s",
            hint="any one heartbeat may be lost: three or four times is better",
        )


def _heartbeats(of: tuple[int, ...] | None, by: int, written: Section) -> list[float]:
    """Return the heartbeats of those nodes that are contact for node `by`, s."""

    def heartbeat(entry: NodeEntry) -> float | None:
        return entry.heartbeat_s if entry.heartbeat_s is not None else written.heartbeat_s

    beats = (
        heartbeat(each)
        for each in written.nodes
        if each.address != by and (of is None or each.address in of)
    )
    return [each for each in beats if each is not None]


def _read_action(
    place: Place, entry: LostContactEntry, by: int, table: StreamTable, ros_streams: Container[int]
) -> LostContactAction:
    """Read what is done."""
    if (entry.call is None) is (entry.publish is None):
        place.refuse(
            'neither "call" nor "publish"' if entry.call is None else '"call" and "publish"',
            allowed="one of them",
            hint="for both, write two entries with names of their own",
        )
    word, key = ("call", entry.call) if entry.call is not None else ("publish", entry.publish)
    assert key is not None
    # ROS names begin with a slash, and a stream of ROS is named without it.
    stream = next((each for each in table if each.name in (key, key.removeprefix("/"))), None)
    is_ros = stream is not None and stream.stream_id in ros_streams
    if stream is not None and is_ros:
        key = stream.name
        if entry.publish is not None:
            place.at(word).refuse(
                f'"{entry.publish}" is a topic of ROS 2',
                allowed="a key of Zenoh",
                hint="call a service of ROS 2 instead, such as a std_srvs/srv/Trigger",
            )
    fault = fault_of_name(key) or ("has a placeholder; allowed: none" if "{" in key else None)
    if fault is not None:
        place.at(word).refuse(f'"{key}" {fault}')
    encoding = entry.encoding or CBOR
    stream_id, value = None, entry.value
    if entry.call is not None and stream is not None:
        if not isinstance(stream.spec, ServiceSpec):
            place.at(word).refuse(f'"{key}" is no service', allowed="a service, or another key")
        if stream.spec.server != by:
            place.at(word).refuse(
                f'"{key}" is served by node {stream.spec.server}, beyond the channel',
                allowed=f"a service of the local network of node {by}",
            )
        if stream.spec.request_type is not None:
            stream_id, value = stream.stream_id, {} if value is None else value
            try:
                stream.codec.encode(value)
            except ZacousticError as error:
                place.at("value").refuse(f"does not fit {key}: {error}")
    payload = b""
    if value is not None and stream_id is None:
        try:
            payload = encode_application(value, encoding)
        except PayloadInvalidError as error:
            place.at("value").refuse(str(error), allowed=place.at("value").allowed)
    return LostContactAction(
        rule=LostContactRule(
            name=entry.name,
            nodes=tuple(sorted(set(entry.of or ()))),
            lost_after_s=entry.lost_after_s,
        ),
        key=key,
        is_call=entry.call is not None,
        value=value,
        payload=payload,
        encoding=encoding,
        stream_id=stream_id,
        is_ros=is_ros,
        timeout_s=entry.timeout_s,
    )
