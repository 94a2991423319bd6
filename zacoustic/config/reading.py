"""Reads a section into a `Config`: addresses and names, types, streams."""

import importlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from zacoustic.config.allowedtopics import AllowedTopics, give_ids, read_allowed_topics
from zacoustic.config.bonds import read_bonded, read_bonds
from zacoustic.config.carry import check_carries_nothing
from zacoustic.config.contact import read_contact
from zacoustic.config.flood import read_flood
from zacoustic.config.json5 import read_zenoh_config
from zacoustic.config.links import (
    is_replaced,
    read_link_rules,
    read_links,
    read_links_of_streams,
)
from zacoustic.config.lostcontact import LostContactAction, read_lost_contact
from zacoustic.config.metrics import parse_metrics
from zacoustic.config.model import check_model, read_model
from zacoustic.config.objects import read_objects
from zacoustic.config.onrmwdesert import check_section
from zacoustic.config.problems import Place, unknown_key
from zacoustic.config.quiet import read_quiet
from zacoustic.config.ranging import check_ranging
from zacoustic.config.references import Known, check_references
from zacoustic.config.ros import RosConfig, RosReader
from zacoustic.config.routes import read_routes
from zacoustic.config.sections import (
    ZENOH_KEYS,
    CarryEntry,
    LinkEntry,
    RangingEntry,
    Section,
    TypeEntry,
)
from zacoustic.config.security import read_security, seal_rules
from zacoustic.config.streams import Fleet, read_streams
from zacoustic.core.base.linktypes import Address
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.lostcontact import LostContactRule
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.relay.relay import RelayRules
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.values.types import (
    TypeSpec,
    TypeTable,
    check_agreement,
    struct_from_type,
    type_from_struct,
)
from zacoustic.errors import ConfigError
from zacoustic.seal.spec import SecuritySpec
from zacoustic.text.allowed import find, table_of
from zacoustic.text.digits import whole_number

if TYPE_CHECKING:  # the import costs a shared library, which a node without Zenoh does not need
    import zenoh

ALLOWED_TOPICS_WIRE: Final = f'wire: "{WireProfile.RMW_DESERT.value}"'
"""The setting that the key `allowed_topics` of a link needs."""
RATIO: Final = "^ *([0-9]{1,15}) */ *(0*[1-9][0-9]{0,14}) *$"
"""Pattern of a step that is written as a ratio."""


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """A node and the streams that cross the channel: the section, checked and interpreted."""

    source: str
    """The file, or another source."""
    address: int
    """Acoustic address of this node, 1…254."""
    nodes: dict[int, str]
    """Name of each node by address; empty if the fleet is not listed."""
    links: tuple[LinkEntry, ...]
    """The links, the first one for streams that name none; may be empty."""
    types: TypeTable
    """The types by name."""
    python_types: dict[str, type[msgspec.Struct]]
    """The Python class of each type that names one."""
    table: StreamTable
    """The streams."""
    typical_bits: dict[int, float] = {}
    """Typical bits of a sample of a dense stream, as a fit has measured them, by stream id; empty
    without a model."""
    journal: Path | None = None
    """Folder of the journal; None: nothing survives a restart."""
    ranging: tuple[RangingEntry, ...] = ()
    """Ranges that this node and other nodes of the fleet measure periodically."""
    lost_contact: tuple[LostContactAction, ...] = ()
    """What the gateway of this node does when it hears nobody any more."""
    ros: RosConfig | None = None
    """The file's ROS settings; None: no ROS stream."""
    rules: TransmitRules = TransmitRules()
    """Rules of when and how much this node may transmit."""
    security: SecuritySpec | None = None
    """The seal of frames; None: no seal. The key file has not been read."""
    permit_log: Path | None = None
    """File to which the node appends each emission, or None."""
    metrics: tuple[str, int] | None = None
    """Host and port at which a gateway answers Prometheus; None: it does not."""
    metrics_names: tuple[str, ...] = ()
    """Host names under which Prometheus finds it, besides this computer's own."""
    zenoh_config: "zenoh.Config | None" = None
    """The whole file for `zenoh.open`; None if the section did not come from a file."""

    @property
    def name(self) -> str | None:
        """Name of this node; None if the fleet is not listed."""
        return self.nodes.get(self.address)

    def class_of(self, type_name: str) -> type[msgspec.Struct]:
        """Return the Python class of a type: the class that the file names, or a generated one.

        Args:
            type_name: Name of the type in streams.

        Raises:
            ConfigError: There is no such type; the message lists the types.
        """
        spec = self.types.by_name(type_name)
        return self.python_types.get(type_name) or struct_from_type(spec)

    def ranges_to(self) -> dict[int, float]:
        """Return the period of each node whose range this node measures, s, by address."""
        return {
            entry.to: entry.every_s
            for entry in self.ranging
            if entry.by in (None, self.address) and entry.to != self.address
        }

    def address_of(self, name: str) -> int:
        """Return the address of the node with this name.

        Raises:
            ConfigError: No node has the name; the message lists the names.
        """
        for address, known in self.nodes.items():
            if known == name:
                return address
        known_names = ", ".join(self.nodes.values()) or "none, nodes is empty"
        raise ConfigError(f'{self.source}: no node is called "{name}"; allowed: {known_names}')


def read_config(
    path: str | Path, *, address: int | None = None, locator: str | None = None
) -> Config:
    """Read the section `plugins.acoustic` of a Zenoh config file.

    Args:
        path: A `.json5`, `.json` or `.yaml` file.
        address: Address of this node; overrides the file's.
        locator: Locator of the modem; overrides the file's links.

    Raises:
        ConfigError: One line: file, key path, value, allowed values, what to do.
    """
    zenoh_config, section = read_zenoh_config(path)
    config = config_from_mapping(
        section, source=str(path), address=address, locator=locator, folder=Path(path).parent
    )
    journal = None if config.journal is None else Path(path).parent / config.journal
    permit_log = None if config.permit_log is None else Path(path).parent / config.permit_log
    return msgspec.structs.replace(
        config, journal=journal, permit_log=permit_log, zenoh_config=zenoh_config
    )


def config_from_mapping(
    section: object,
    *,
    source: str,
    address: int | None = None,
    locator: str | None = None,
    folder: Path | None = None,
) -> Config:
    """Read a section from plain objects.

    Args:
        section: The mapping; anything else is refused.
        source: Its source, for errors.
        address: Address of this node; overrides the section's.
        locator: Locator of the modem; overrides the section's links.
        folder: Folder to which the model, the key and the ROS packages are relative; default: the
            present one.

    Raises:
        ConfigError: One line: source, key path, value, allowed values, what to do.
    """
    if isinstance(section, Mapping):
        section = {key: value for key, value in section.items() if key not in ZENOH_KEYS}
    place = Place(source, section)
    if not isinstance(section, dict):
        place.refuse(allowed="{ address, nodes, links, types, journal, streams, ranging }")
    for key in section:
        if not isinstance(key, str):
            unknown_key(place, str(key), Section.__struct_fields__)
    place = Place(source, _with_steps(section))
    place, topics = _read_allowed_topics(place, folder or Path())
    written = place.convert(Section)
    nodes = {each.address: each.name for each in written.nodes}
    known = _known(written, nodes)
    check_references(place.at("nodes"), written.nodes, find(table_of(Section), ["nodes"]), known)
    own = _own_address(place.at("address"), written.address, address, nodes)
    links = read_links(place.at("links"), written.links, locator, own)
    check_references(place, written, None, known)
    routes = read_routes(place, written.routes, written.links)
    ros = RosReader(place, written, folder or Path())
    ros_types = ros.types(place.at("streams"))
    types, python_types = _read_types(place.at("types"), written.types, ros_types)
    objects = read_objects(place.at("objects"), written.objects)
    wire = WireProfile(links[0].wire) if links else WireProfile.NATIVE
    if wire is WireProfile.RMW_DESERT:
        check_section(place, written)
    read = read_model(place.at("model"), written.model, folder or Path())
    fleet = Fleet(
        nodes=nodes,
        known=known,
        types=types,
        largest_bytes=objects.largest_bytes,
        model=read.model if read is not None else None,
        wire=wire,
    )
    table = read_streams(place.at("streams"), fleet, ros)
    check_model(place.at("model"), table)
    security = read_security(place.at("security"), written.security, table, folder or Path())
    lost_contact = read_lost_contact(place.at("lost_contact"), written, own, table, ros.streams)
    losses = tuple(each.rule for each in lost_contact)
    rules = _read_rules(
        place, written, links, routes, fleet, own, objects, topics, security, losses
    )
    journal = _path_of(place.at("journal"), written.journal)
    if journal is None:
        check_carries_nothing(place, table, own)
    return Config(
        source=source,
        address=own,
        nodes=nodes,
        links=links,
        types=types,
        python_types=python_types,
        journal=journal,
        table=table,
        typical_bits=_by_id(read.typical_bits) if read is not None else {},
        ranging=check_ranging(place.at("ranging"), written.ranging, own),
        lost_contact=lost_contact,
        ros=ros.config() if ros.streams else None,
        rules=rules,
        security=security,
        permit_log=_path_of(place.at("permit_log"), written.permit_log),
        metrics=_read_metrics(place.at("metrics"), written.metrics),
        metrics_names=written.metrics_names,
    )


def _with_steps(section: dict[str, Any]) -> dict[str, Any]:
    """Replace steps that are written as ratios, "1/60000", by numbers."""
    types = section.get("types")
    if not isinstance(types, list):
        return section
    entries = []
    for entry in types:
        fields = entry.get("fields") if isinstance(entry, dict) else None
        if isinstance(fields, list):
            entry = {**entry, "fields": [_with_step(field) for field in fields]}
        entries.append(entry)
    return {**section, "types": entries}


def _with_step(field: Any) -> Any:  # noqa: ANN401 (as it is written)
    step = field.get("step") if isinstance(field, dict) else None
    ratio = re.match(RATIO, step) if isinstance(step, str) else None
    if ratio is None:
        return field
    return {**field, "step": int(ratio[1]) / int(ratio[2])}


def _read_allowed_topics(place: Place, folder: Path) -> tuple[Place, AllowedTopics | None]:
    """Read rmw_desert's file, if a link names one; return the section with its ids."""
    for here in place.at("links").items:
        written = here.at("allowed_topics").written
        if not isinstance(written, str):
            continue
        if here.at("wire").written != WireProfile.RMW_DESERT.value:
            here.at("allowed_topics").refuse(
                f"{written} without {ALLOWED_TOPICS_WIRE}", allowed=f"with {ALLOWED_TOPICS_WIRE}"
            )
        topics = read_allowed_topics(here.at("allowed_topics"), written, folder)
        streams = give_ids(place.at("streams"), topics)
        return Place(place.source, place.written | {"streams": streams}), topics
    return place, None


def _by_id(by_text: Mapping[str, float]) -> dict[int, float]:
    return {
        stream_id: bits
        for text, bits in by_text.items()
        if (stream_id := whole_number(text)) is not None
    }


def _known(written: Section, nodes: Mapping[int, str]) -> Known:
    """Return what addresses and names of the section may refer to."""
    links: dict[object, str] = {each.name: each.name for each in written.links if each.name}
    ways = links | {each.name: each.name for each in written.routes}
    known = {"links": links, "ways": ways}
    if nodes:
        known["nodes"] = {address: f"{address} ({name})" for address, name in nodes.items()}
    return known


def _own_address(
    place: Place, written: int | None, given: int | None, nodes: Mapping[int, str]
) -> int:
    own = written if given is None else given
    if own is None:
        place.refuse("is missing", allowed=place.allowed, hint="add it, or give --address")
    try:
        msgspec.convert(own, Address)
        is_address = not nodes or own in nodes
    except msgspec.ValidationError:
        is_address = False
    if not is_address:
        what = f"{own}" if given is None else f"{own}, given beside the file"
        place.refuse(what, allowed=place.allowed)
    return own


def _path_of(place: Place, written: str | None) -> Path | None:
    """Return the path at `place`, relative to the file; None: none is named."""
    return None if written is None else place.path_of(written, Path())


def _read_metrics(place: Place, written: str | None) -> tuple[str, int] | None:
    """Return where metrics are answered; None: nowhere."""
    found = None if written is None else parse_metrics(written)
    if found is None and written is not None:
        place.refuse()
    return found


def _read_rules(
    place: Place,
    written: Section,
    links: tuple[LinkEntry, ...],
    routes: tuple[Route, ...],
    fleet: Fleet,
    own: int,
    objects: ObjectLimits,
    topics: AllowedTopics | None,
    security: SecuritySpec | None,
    lost_contact: tuple[LostContactRule, ...],
) -> TransmitRules:
    """Read the settings of transmission."""
    own_links = read_link_rules(place, written, links, fleet.wire)
    commands_from = None if written.commands_from is None else frozenset(written.commands_from)
    is_other = is_replaced(written.links, links)
    flood, flooded = read_flood(place, written.flood, written.links, written.routes, fleet.wire)
    bonds, bonded, default = read_bonds(place, routes, is_in_use=not is_other)
    rules = TransmitRules(
        access=own_links[0].access if own_links else None,
        quiet=read_quiet(place.at("quiet"), written.quiet),
        max_airtime=own_links[0].max_airtime if own_links else written.max_airtime,
        max_frame_s=own_links[0].max_frame_s if own_links else written.max_frame_s,
        commands_from=commands_from,
        contact=read_contact(place, written, own, lost_contact),
        agreement=written.agreement or AgreementMethod.CONFIRM,
        objects=objects,
        carry_bytes=(written.carry or CarryEntry()).max_bytes,
        discovery=topics.discovery(fleet.nodes.get(own, f"zacoustic_{own}")) if topics else None,
        links=own_links if any(each.name for each in links) else (),
        links_of_streams=read_links_of_streams(place.at("streams"), links, routes, own)
        | bonded
        | flooded,
        default_link=default,
        flood=flood,
        bonds=bonds,
        bonded_routes={
            entry.name: read_bonded(entry)
            for entry in written.routes
            if entry.down_after_s is not None or entry.probe_s is not None
        },
        routes=routes,
        relay=written.relay or RelayRules(),
        sealing=seal_rules(security),
        port=own_links[0].port if own_links else None,
    )
    return rules.on_one_link() if is_other else rules


def _read_types(
    place: Place, entries: tuple[TypeEntry, ...], others: list[TypeSpec]
) -> tuple[TypeTable, dict[str, type[msgspec.Struct]]]:
    python_types: dict[str, type[msgspec.Struct]] = {}
    specs: list[TypeSpec] = []
    for index, entry in enumerate(entries):
        here = place.at(index)
        if entry.fields is None and entry.python is None:
            here.at("fields").refuse(
                "is missing", allowed="a list of { name, type, … }, or python instead"
            )
        if entry.python is not None:
            python_types[entry.name] = _import_class(here.at("python"), entry.python)
        try:
            if entry.fields is None:
                specs.append(type_from_struct(python_types[entry.name], name=entry.name))
            else:
                specs.append(TypeSpec(name=entry.name, fields=entry.fields))
        except ConfigError as error:
            if entry.fields is None:
                here.at("python").refuse(f'"{entry.python}": {error.args[0]}', hint=error.hint)
            here.repeat(error)
    root = Place(place.source, {"types": place.written})
    try:
        types = TypeTable([*specs, *others])
        for index, entry in enumerate(entries):
            if entry.fields is not None and entry.name in python_types:
                stated = type_from_struct(python_types[entry.name], name=entry.name)
                check_agreement(types[entry.name], stated, path=f"types[{index}]")
    except ConfigError as error:
        root.repeat(error)
    return types, python_types


def _import_class(place: Place, reference: str) -> type[msgspec.Struct]:
    module_name, _, attribute = reference.partition(":")
    try:
        found: object = importlib.import_module(module_name)
    except Exception as error:  # the user's module: the file names it, so its errors are the file's
        reason = " ".join(str(error).split())
        place.refuse(
            f'"{reference}" cannot be imported: {type(error).__name__}: {reason}',
            allowed='"module:Class" of an installed module',
            hint="is its folder on PYTHONPATH?",
        )
    for name in attribute.split("."):
        found = getattr(found, name, None)
    if not (isinstance(found, type) and issubclass(found, msgspec.Struct)):
        place.refuse(
            f'"{reference}" is no msgspec.Struct', allowed='"module:Class" of a msgspec.Struct'
        )
    return found
