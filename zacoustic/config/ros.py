"""ROS 2 in the section: interfaces as types; topics, services and actions of ROS as streams.

A stream with a ROS type need not be a ROS stream: on Zenoh it is then CBOR with the member names of
the definition, as any other. With ``ros: {}`` it is a stream of rmw_zenoh. Frames are the same, so
the two ends may differ in this.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeGuard

import msgspec

from zacoustic.config.problems import Place, shown
from zacoustic.config.sections import RosDomain, RosEntry, Section, StreamRosEntry
from zacoustic.core.base.qos import Stamp
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import ConfigError
from zacoustic.ros.interfaces import Interfaces, has_header, stamped_list
from zacoustic.ros.names import check_namespace, is_interface, stream_name
from zacoustic.ros.qos import RosDurability, RosQos, RosReliability
from zacoustic.ros.streams import (
    RosStream,
    RosTopic,
    messages_of,
    ros_action,
    ros_service,
)
from zacoustic.text.digits import whole_number
from zacoustic.text.installing import with_extra

if TYPE_CHECKING:  # these need rosbags, which a file without ROS does not need
    from zacoustic.ros.mapping import TypeMapper
    from zacoustic.ros.messages import RosMessage

DOMAIN_VARIABLE: Final = "ROS_DOMAIN_ID"
"""Environment variable with the domain."""
_LATCHED_PUBLISHERS: Final = 4
"""Publishers with a depth of their own, as each has in ROS: nodes that publish `/tf_static`."""
_TRANSIENT_LOCAL: Final = "transient_local"
_EXACT: Final = "exact"

_KINDS: Final = {"topic": "msg", "service": "srv", "action": "action"}
_TYPE_KEYS: Final = {
    "topic": ("type",),
    "service": ("type", "request", "response"),
    "action": ("type", "goal", "feedback", "result"),
}
_PARTS: Final = {
    "topic": {"type": ""},
    "service": {"request": "_Request", "response": "_Response"},
    "action": {"goal": "_Goal", "feedback": "_Feedback", "result": "_Result"},
}


class RosConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The file's ROS settings."""

    domain: int
    """``ROS_DOMAIN_ID``."""
    distro: str
    """The distribution."""
    streams: dict[int, RosStream]
    """The streams that are of ROS, by id."""


class RosReader:
    """Reads the ROS settings of the section and of its streams.

    Args:
        place: The section.
        written: Its content.
        folder: Folder to which the folder of packages is relative.

    Raises:
        ConfigError: The section's ROS settings are wrong, or the extra is missing.
    """

    def __init__(self, place: Place, written: Section, folder: Path) -> None:
        self.streams: dict[int, RosStream] = {}
        """The ROS streams read so far, by id."""
        self._place = place
        self._entry = written.ros or RosEntry()
        self._folder = folder
        self._overlays = written.overlays
        # Types that the file defines are not looked up.
        self._defined = {each.name for each in written.types}
        is_desert = any(each.wire == WireProfile.RMW_DESERT.value for each in written.links)
        self._wire = WireProfile.RMW_DESERT if is_desert else WireProfile.NATIVE
        self._interfaces: Interfaces | None = None
        self._mapper: TypeMapper | None = None
        self._messages: dict[tuple[str, str], RosMessage] = {}
        here = place.at("ros")
        self.domain = _domain(here.at("domain"), self._entry.domain)
        try:
            check_namespace(self._entry.namespace)
        except ConfigError as error:
            here.at("namespace").refuse(str(error.args[0]))
        if written.ros is not None or written.overlays:
            self._load()
            self._check_overlays()

    def config(self) -> RosConfig:
        """Return the result, once all streams are read."""
        return RosConfig(domain=self.domain, distro=self._entry.distro, streams=self.streams)

    def types(self, streams: Place) -> list[TypeSpec]:
        """Return the types of the ROS interfaces that streams and types of the section name."""
        found: dict[str, TypeSpec] = {}
        for here in streams.items:
            kind = next((kind for kind in _KINDS if here.at(kind).written is not None), "")
            for key in _TYPE_KEYS.get(kind, ()):
                name = here.at(key).written
                if self._is_interface(name):
                    for spec in self._types_of(here, key, name):
                        found[spec.name] = spec
        for place in self._field_types():
            spec = self._message(place, place.written, _EXACT).spec
            found[spec.name] = spec
        return list(found.values())

    def resolve(self, place: Place, kind: str) -> dict[str, Any]:
        """Return the table of a stream with ROS types and names resolved.

        Args:
            place: The table.
            kind: topic, service or action.

        Raises:
            ConfigError: The stream's ROS settings are wrong.
        """
        written: dict[str, Any] = dict(place.written)
        name = written.get("type")
        is_ros = written.pop("ros", None) is not None
        if self._is_interface(name):
            written |= self._typed(place, kind, name)
        elif is_ros:
            place.at("type").refuse(
                shown(name) if name is not None else "is missing",
                allowed=f'a ROS type, such as "{_EXAMPLES[kind]}"',
            )
        elif kind != "topic" and name is not None:
            place.at("type").refuse(
                allowed=f'a ROS type, such as "{_EXAMPLES[kind]}"',
                hint=f"other types: {', '.join(_PARTS[kind])}",
            )
        if kind != "topic":
            written.pop("type", None)
        if is_ros:
            written |= self._ros(place, kind, str(name))
        return written

    # Below the methods above

    def _is_interface(self, name: object) -> TypeGuard[str]:
        """Tell whether a type names a ROS interface."""
        return isinstance(name, str) and is_interface(name) and name not in self._defined

    def _load(self) -> Interfaces:
        if self._interfaces is not None:
            return self._interfaces
        here = self._place.at("ros")
        packages = self._entry.packages
        folder = self._folder / packages if packages is not None else None
        if folder is not None and not folder.is_dir():
            here.at("packages").refuse(f"{shown(packages)} is no folder", allowed="a folder")
        try:
            self._interfaces = Interfaces(self._entry.distro, folder)
            from zacoustic.ros.mapping import TypeMapper

            self._mapper = TypeMapper(self._interfaces, self._overlays, wire=self._wire)
        except ImportError as error:
            here.refuse(f"ROS 2 needs {error.name}", hint=with_extra("ros"))
        except ConfigError as error:
            key = "distro" if str(error.args[0]).startswith('"') else "packages"
            is_package = "needs the package" in str(error.args[0])
            (here if is_package else here.at(key)).refuse(str(error.args[0]), hint=error.hint)
        return self._interfaces

    def _check_overlays(self) -> None:
        """Check that each rule fits some member of its type."""
        assert self._mapper is not None
        for index, overlay in enumerate(self._overlays):
            here = self._place.at("overlays").at(index)
            try:
                self._mapper.map(overlay.type)
            except ConfigError as error:
                known = self._interfaces is not None and overlay.type in self._interfaces
                (here if known else here.at("type")).refuse(str(error.args[0]), hint=error.hint)
            for number, field in enumerate(overlay.fields):
                if id(field) not in self._mapper.used:
                    here.at("fields").at(number).at("field").refuse(
                        f'"{field.field}" names no member of {overlay.type}',
                        allowed="members, parted by dots; * stands for any one",
                    )

    def _message(self, place: Place, name: str, stamp: str) -> "RosMessage":
        interfaces = self._load()
        from zacoustic.ros.messages import HeaderStamp, RosMessage

        known = self._messages.get((name, stamp))
        if known is not None:
            return known
        assert self._mapper is not None
        try:
            message = RosMessage(interfaces, self._mapper, name, HeaderStamp(stamp))
        except ConfigError as error:
            place.refuse(str(error.args[0]), hint=error.hint)
        self._messages[(name, stamp)] = message
        return message

    def _types_of(self, place: Place, key: str, name: str) -> list[TypeSpec]:
        """Return the types of an interface, named by a stream, that cross the channel."""
        kinds = {word: kind for kind, word in _KINDS.items()}
        kind = kinds.get(name.split("/")[1], "topic")
        if key == "type" and kind != "topic":
            return [
                self._message(place.at(key), name + suffix, _EXACT).spec
                for suffix in _PARTS[kind].values()
                if name + suffix in self._load()
            ]
        stamp = self._stamp(place, name) if key == "type" else _EXACT
        return [self._message(place.at(key), name, stamp).spec]

    def _stamp(self, place: Place, name: str) -> str:
        """Return the treatment of a topic's `header.stamp`."""
        here = place.at("ros")
        if here.written is None:
            return _EXACT
        stamp = here.convert(StreamRosEntry).stamp or _EXACT
        interfaces = self._load()
        if stamp == _EXACT or name not in interfaces or has_header(interfaces, name):
            return stamp
        if stamp != "age" or stamped_list(interfaces, name) is None:
            here.at("stamp").refuse(allowed=f"{_EXACT}: {name} has no header")
        return stamp

    def _field_types(self) -> list[Place]:
        """Return the places at which fields of types name interfaces."""
        types = self._place.at("types").items
        fields = [field.at("type") for each in types for field in each.at("fields").items]
        return [each for each in fields if self._is_interface(each.written)]

    def _typed(self, place: Place, kind: str, name: str) -> dict[str, Any]:
        """Return the types of the parts of a stream."""
        if name.split("/")[1] != _KINDS[kind]:
            place.at("type").refuse(
                f'"{name}" for {_ARTICLES[kind]}', allowed=f"PACKAGE/{_KINDS[kind]}/Name"
            )
        for key in _PARTS[kind]:
            if key != "type" and place.at(key).written is not None:
                place.at(key).refuse("beside type", allowed="one of them")
        stamp = self._stamp(place, name) if kind == "topic" else _EXACT
        return {
            key: self._message(place.at("type"), name + suffix, stamp).spec.name
            for key, suffix in _PARTS[kind].items()
        }

    def _ros(self, place: Place, kind: str, name: str) -> dict[str, Any]:
        """Register a ROS stream; return the entry to read in its place."""
        if place.at("encoding").written is not None:
            place.at("encoding").refuse(
                f"{shown(place.at('encoding').written)} with ros", allowed="none: ROS has CDR"
            )
        interfaces, identity = self._load(), place.at("id").written
        try:
            called = stream_name(str(place.at(kind).written), self._entry.namespace)
        except ConfigError as error:
            place.at(kind).refuse(str(error.args[0]), hint=error.hint)
        messages = {
            each: self._message(place.at("type"), each, _EXACT)
            for each in messages_of(name)
            if kind != "topic"
        }
        changed: dict[str, Any] = {kind: called}
        if kind == "topic":
            stamp = self._stamp(place, name)
            if place.at("wildcards").items:
                place.at("wildcards").refuse("with ros", allowed="{node} alone")
            topic = RosTopic(
                interface=name,
                hash=interfaces.hash_of(name),
                message=self._message(place.at("type"), name, stamp),
                qos=_qos(place.written),
            )
            self.streams[identity] = topic
            if stamp == Stamp.AGE.value:
                changed["stamp"] = stamp
            if topic.qos.durability is RosDurability.TRANSIENT_LOCAL:
                changed["local_publishers"] = place.written.get(
                    "local_publishers", _LATCHED_PUBLISHERS
                )
            return changed
        if place.at("ros").at("stamp").written is not None:
            place.at("ros").at("stamp").refuse(f"of {_ARTICLES[kind]}", allowed="of topics")
        make = ros_service if kind == "service" else ros_action
        self.streams[identity] = make(interfaces, name, messages)
        return changed


_EXAMPLES: Final = {
    "topic": "geometry_msgs/msg/Twist",
    "service": "std_srvs/srv/SetBool",
    "action": "example_interfaces/action/Fibonacci",
}
_ARTICLES: Final = {"topic": "a topic", "service": "a service", "action": "an action"}


def _qos(written: Mapping[str, Any]) -> RosQos:
    """Return the QoS of the gateway's endpoints for a topic."""
    is_reliable = written.get("reliability") == "reliable"
    is_latched = written.get("durability") == _TRANSIENT_LOCAL
    depth = written.get("depth", 1)
    return RosQos(
        reliability=RosReliability.RELIABLE if is_reliable else RosReliability.BEST_EFFORT,
        durability=RosDurability.TRANSIENT_LOCAL if is_latched else RosDurability.VOLATILE,
        depth=depth if isinstance(depth, int) else 1,
    )


def _domain(place: Place, written: int | None) -> int:
    if written is not None:
        return written
    text = os.environ.get(DOMAIN_VARIABLE, "") or "0"
    try:
        return msgspec.convert(whole_number(text), RosDomain)
    except msgspec.ValidationError:
        what = f"{shown(text)} in ${DOMAIN_VARIABLE}"
        place.refuse(what, allowed=place.allowed, hint="or say it here")
