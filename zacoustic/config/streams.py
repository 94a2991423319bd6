"""The list `streams`: each entry is told apart by its keys, checked, and declared in the table."""

import re
from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.config.complaints import Place
from zacoustic.config.later import check_word, refuse_later_keys
from zacoustic.config.sections import ALLOWED, ServiceEntry, StreamEntry, TopicEntry
from zacoustic.core.encoding import LONGEST_ENCODING_BYTES, TYPED_ENCODINGS
from zacoustic.core.keys import NODE_PLACEHOLDER, Wildcard
from zacoustic.core.qos import PRIORITY_NAMES, Qos, Stamp
from zacoustic.core.streams import CODECS, ServiceSpec, StreamSpec, StreamTable, TopicSpec
from zacoustic.core.types import TypeTable
from zacoustic.errors import ConfigError

_KINDS: Final = ("topic", "service")
# How `Qos` words its refusals: the key, the value, what is allowed.
_QOS_REFUSAL: Final = re.compile(r"(\w+) is .*; allowed: (.*)")


class Fleet(msgspec.Struct, frozen=True, kw_only=True):
    """What streams refer to."""

    nodes: dict[int, str]
    """Name of each node by address; empty: not listed."""
    types: TypeTable
    """The types by name."""


def read_streams(place: Place, count: int, fleet: Fleet) -> StreamTable:
    """Read the list at `place`, which has `count` entries.

    Raises:
        ConfigError: The first entry that is wrong.
    """
    table = StreamTable(types=fleet.types, nodes=fleet.nodes)
    for index in range(count):
        here = place.at(index)
        spec = _read_stream(here, fleet)
        try:
            table.declare(spec)
        except ConfigError as error:
            here.repeat(_in_written_keys(error, spec))
    return table


def _read_stream(place: Place, fleet: Fleet) -> StreamSpec:
    refuse_later_keys(place, "streams")
    kinds = [kind for kind in _KINDS if kind in place.written]
    if len(kinds) != 1:
        what = "both topic and service" if kinds else "neither topic nor service"
        place.complain(what, allowed="one of topic, service")
    if kinds[0] == "topic":
        return _read_topic(place, place.convert(TopicEntry), fleet)
    return _read_service(place, place.convert(ServiceEntry), fleet)


def _read_topic(place: Place, entry: TopicEntry, fleet: Fleet) -> TopicSpec:
    check_word(place.at("reliability"), entry.reliability, ("best_effort",))
    check_word(place.at("durability"), entry.durability, ("volatile",))
    check_word(place.at("forward"), entry.forward, ("always",))
    check_word(place.at("stamp"), entry.stamp, tuple(stamp.value for stamp in Stamp))
    _check_type(place.at("type"), entry.type, fleet)
    _check_codec(place, entry, is_typed=entry.type is not None)
    _check_addresses(place.at("publishers"), entry.publishers, fleet)
    _check_addresses(place.at("subscribers"), entry.subscribers, fleet)
    if f"{{{NODE_PLACEHOLDER}}}" in entry.topic and not fleet.nodes:
        place.at("topic").complain(
            f'"{entry.topic}" has {{node}}, and nodes is empty', allowed="with nodes listed"
        )
    qos = _read_qos(
        place,
        lambda: Qos(
            priority=PRIORITY_NAMES[entry.priority],
            depth=entry.depth,
            lifespan_s=entry.lifespan_s,
            min_interval_s=entry.min_interval_s,
            linger_s=entry.linger_s,
            max_airtime=entry.max_airtime,
            stamp=Stamp(entry.stamp),
        ),
    )
    return TopicSpec(
        stream_id=entry.id,
        name=entry.topic,
        type_name=entry.type,
        publishers=entry.publishers,
        subscribers=entry.subscribers,
        wildcards=tuple(Wildcard(name=each.name, values=each.values) for each in entry.wildcards),
        encoding=entry.encoding,
        codec=entry.codec or "cbor",
        qos=qos,
        journal=entry.journal,
    )


def _read_service(place: Place, entry: ServiceEntry, fleet: Fleet) -> ServiceSpec:
    _check_type(place.at("request"), entry.request, fleet)
    _check_type(place.at("response"), entry.response, fleet)
    is_typed = entry.request is not None or entry.response is not None
    _check_codec(place, entry, is_typed=is_typed)
    check_address(place.at("server"), entry.server, fleet)
    qos = _read_qos(
        place,
        lambda: Qos(
            priority=PRIORITY_NAMES[entry.priority],
            linger_s=entry.linger_s,
            max_airtime=entry.max_airtime,
        ),
    )
    return ServiceSpec(
        stream_id=entry.id,
        name=entry.service,
        server=entry.server,
        request_type=entry.request,
        response_type=entry.response,
        timeout_s=entry.timeout_s,
        encoding=entry.encoding,
        codec=entry.codec or "cbor",
        qos=qos,
        journal=entry.journal,
    )


def _check_codec(place: Place, entry: StreamEntry, *, is_typed: bool) -> None:
    """Check codec, encoding and priority."""
    check_word(place.at("priority"), entry.priority, tuple(PRIORITY_NAMES))
    if entry.codec is not None:
        check_word(place.at("codec"), entry.codec, tuple(CODECS))
        if not is_typed:
            place.at("codec").complain(
                f'"{entry.codec}" for opaque bytes', allowed="typed streams", hint="add a type"
            )
    if entry.encoding is None:
        return
    if is_typed and entry.encoding.split(";", 1)[0] not in TYPED_ENCODINGS:
        place.at("encoding").complain(allowed=f"for a typed stream {', '.join(TYPED_ENCODINGS)}")
    if not 1 <= len(entry.encoding.encode(errors="replace")) <= LONGEST_ENCODING_BYTES:
        place.at("encoding").complain(allowed=f"1..{LONGEST_ENCODING_BYTES} bytes of text")


def _check_type(place: Place, name: str | None, fleet: Fleet) -> None:
    if name is None:
        return
    try:
        fleet.types.by_name(name)
    except ConfigError as error:
        _, _, allowed = str(error.args[0]).partition("allowed: ")
        place.complain(f'"{name}" is not known', allowed=allowed, hint=error.hint)


def _check_addresses(place: Place, addresses: tuple[int, ...] | None, fleet: Fleet) -> None:
    if addresses is None:
        return
    if not addresses:
        place.complain(allowed="at least one address", hint="leave it out for all nodes")
    for index, address in enumerate(addresses):
        check_address(place.at(index), address, fleet)
        if address in addresses[:index]:
            place.at(index).complain(f"{address} a second time", allowed="each address once")


def check_address(place: Place, address: int, fleet: Fleet) -> None:
    """Check the address that is written at `place`.

    Raises:
        ConfigError: No node of the fleet has it, or no node can.
    """
    if fleet.nodes and address not in fleet.nodes:
        known = ", ".join(f"{known} ({name})" for known, name in fleet.nodes.items())
        place.complain(f"{address} is no node", allowed=known, hint="add it to nodes")
    if not 1 <= address <= 254:
        place.complain(allowed=ALLOWED["address"])


def _read_qos(place: Place, make: Callable[[], Qos]) -> Qos:
    try:
        return make()
    except ValueError as error:
        refusal = _QOS_REFUSAL.fullmatch(str(error))
        if refusal is None:
            place.complain(str(error))
        place.at(refusal[1]).complain(allowed=refusal[2])


def _in_written_keys(error: ConfigError, spec: StreamSpec) -> ConfigError:
    """The error with the key of the file in place of `name`, which the core says."""
    kind = "service" if isinstance(spec, ServiceSpec) else "topic"
    message = str(error.args[0])
    if message.startswith("name: "):
        message = kind + message.removeprefix("name")
    return ConfigError(message, hint=error.hint)
