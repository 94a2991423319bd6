"""The section as it is written: one record per table of the file, and what each key allows.

The records hold what was written and nothing else; meaning is given in `reading`. `ALLOWED` says in
words what each key takes: it stands in the errors, and in docs/config.md.
"""

from typing import Any, Final

import msgspec

from zacoustic.core.contact import LEAST_HEARTBEAT_S
from zacoustic.core.encoding import TYPED_ENCODINGS
from zacoustic.core.qos import PRIORITY_NAMES, Forward, Reliability, Stamp
from zacoustic.core.ranging import LEAST_PERIOD_S, LONGEST_PERIOD_S
from zacoustic.core.types import SCALAR_TYPES, FieldSpec
from zacoustic.core.wireprofile import WireProfile
from zacoustic.ros.interfaces import DEFAULT_DISTRO
from zacoustic.ros.overlays import Overlay, OverlayField

ALLOWED: Final = {
    "address": "an address, 1..254",
    "id": "a number, 1..175",
    "name": "a text",
    "locator": 'a text, NAME/ADDRESS#key=value, such as "sim/127.0.0.1:7000"',
    "wire": ", ".join(f'"{profile.value}"' for profile in WireProfile),
    "allowed_topics": "a text, rmw_desert's file of topics, such as ros_allowed_topics.conf",
    "access": '{ method: "aloha" | "carrier_sense" | "tdma" | "polling" | "delegated", … }',
    "method": "the name of a medium access",
    "slots": "a list of addresses",
    "slot_s": "seconds, above 0",
    "guard_s": "seconds, above 0",
    "max_range_m": "metres, above 0",
    "clock_error_s": "seconds, 0 or more",
    "clock": "the address of a node",
    "beacon_s": "seconds, above 0",
    "drift_ppm": "a number, 0 or more",
    "back_off": "true, false",
    "poller": "the address of a node",
    "turn_s": "seconds, above 0, at most 5.1",
    "idle_s": "seconds, 0 or more",
    "nodes": "a list of { address, name }",
    "links": "a list with one { locator }",
    "types": "a list of { name, fields } or { name, python }",
    "fields": "a list of { name, type, … }",
    "streams": "a list of { id, topic, … }, { id, service, … } or { id, action, … }",
    "wildcards": "a list of { name, values }",
    "values": "a list of texts",
    "python": 'a text, "module:Class"',
    "type": "a text, the name of a type",
    "journal": "true, false",
    "quiet": 'a list of { from: "22:00", to: "06:00" }',
    "from": 'a time of day in UTC, such as "22:00"',
    "objects": "{ max_bytes, max_waiting, memory_bytes }",
    "max_bytes": "a number of bytes, 1 or more",
    "max_waiting": "a number, 1..64",
    "memory_bytes": "a number of bytes, not less than max_bytes",
    "exclusive": "true, false",
    "max_airtime": "a share, above 0, at most 1",
    "orders_from": "a list of addresses; [] for nobody",
    "permit_log": "a text, the file to append to",
    "metrics": 'a text, "PORT" or "HOST:PORT"',
    "request": "a text, the name of a type",
    "response": "a text, the name of a type",
    "goal": "a text, the name of a type",
    "feedback": "a text, the name of a type",
    "result": "a text, the name of a type",
    "topic": "a text, a key expression",
    "service": "a text, a key expression",
    "action": "a text, a key expression",
    "publishers": "a list of addresses of nodes",
    "subscribers": "a list of addresses of nodes",
    "server": "the address of a node",
    "priority": ", ".join(PRIORITY_NAMES),
    "depth": "a number, 1..65535",
    "lifespan_s": "seconds, above 0",
    "deadline_s": "seconds, 0.1 or more, above min_interval_s",
    "min_interval_s": "seconds, 0 or more",
    "linger_s": "seconds, 0 or more",
    "timeout_s": "seconds, above 0",
    "result_timeout_s": "seconds, above 0",
    "feedback_interval_s": "seconds, 0 or more",
    "stamp": ", ".join(stamp.value for stamp in Stamp),
    "encoding": f"a text, for typed streams one of {', '.join(TYPED_ENCODINGS)}",
    "model": "a file that `zacoustic fit` has made",
    "reliability": ", ".join(reliability.value for reliability in Reliability),
    "durability": '"volatile", "transient_local"',
    "codec": '"cbor", "packed", for topics "dense"',
    "forward": ", ".join(forward.value for forward in Forward),
    "heartbeat_s": f"seconds, {LEAST_HEARTBEAT_S:g} or more",
    "lost_after_s": "seconds, above 0",
    "range": "a list of two numbers, [low, high]",
    "step": 'a number above 0, or a ratio as "1/60000"',
    "unit": "a text",
    "wraps": "true, false",
    "outside": "reject, clamp, escape",
    "optional": "true, false",
    "length": "a number, 1..65535",
    "max_length": "a number, 1..65535",
    "default": "a value of the field's type",
    "ranging": "a list of { to, every_s }",
    "to": "the address of another node",
    "by": "the address of a node",
    "ros": "{ distro, domain, namespace, packages }; of a stream { stamp }",
    "distro": "the name of a ROS 2 distribution",
    "domain": "a number, 0..232",
    "namespace": 'a ROS namespace, such as "/auv1"',
    "packages": "a folder of PACKAGE/msg/Name.msg, PACKAGE/srv/Name.srv and so on",
    "overlays": "a list of { type, fields }",
    "field": "a text, members parted by dots; * stands for any one",
    "constant": "a value",
    "omit": "true, false",
    "every_s": f"seconds, {LEAST_PERIOD_S:g}..{LONGEST_PERIOD_S:g}",
}
"""What each key takes, in words."""

FOLDER_ALLOWED: Final = "a text, the folder of the journal"
"""What the key `journal` of the section takes."""

FIELD_TYPE_ALLOWED: Final = f"{', '.join(SCALAR_TYPES)}, or the name of a type"
"""What the key `type` of a field takes."""

ZENOH_KEYS: Final = ("__required__", "__path__", "__plugin__")
"""Keys of the section that are for Zenoh's plugin loader, not for us."""


class Entry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file; a key that it does not list is an error."""


class NodeEntry(Entry, frozen=True, kw_only=True):
    """One node of the fleet."""

    address: int
    """Acoustic address, 1…254."""
    name: str
    """Name, one chunk of a key: what `{node}` in a topic stands for."""
    heartbeat_s: float | None = None
    """How often the node is to be heard at least, s; none: as the section says."""
    lost_after_s: float | None = None
    """After how long without a sign of it the node counts as lost, s; none: as the section says."""


class LinkEntry(Entry, frozen=True, kw_only=True):
    """One modem."""

    locator: str
    """Which link, where, with which settings: ``NAME/ADDRESS#key=value``."""
    wire: str = WireProfile.NATIVE.value
    """Wire profile."""
    allowed_topics: str | None = None
    """rmw_desert's file of topics and ids, relative to the file's; none: ids are in the streams."""
    access: dict[str, Any] | None = None
    """Medium access, read by `zacoustic.config.access`; none: as the link says."""


class TypeEntry(Entry, frozen=True, kw_only=True):
    """One type, written here, or in Python, or both."""

    name: str
    """What streams and fields call it."""
    fields: tuple[FieldSpec, ...] | None = None
    """The fields in the order in which they travel."""
    python: str | None = None
    """``module:Class`` of a `msgspec.Struct`."""


class WildcardEntry(Entry, frozen=True, kw_only=True):
    """A placeholder of a topic and the values it can take."""

    name: str
    """As it stands between the braces."""
    values: tuple[str, ...]
    """Key chunks; the position is what crosses the water."""


class QuietEntry(Entry, frozen=True, kw_only=True, rename={"begin": "from", "end": "to"}):
    """Hours of each day at which nothing is transmitted."""

    begin: str
    """Time of day in UTC, ``HH:MM``; `from` in the file."""
    end: str
    """Time of day in UTC, ``HH:MM``; `to` in the file."""


class ObjectsEntry(Entry, frozen=True, kw_only=True):
    """How much memory samples may take that are larger than a frame."""

    max_bytes: int | None = None
    """Largest sample that is sent or taken, bytes."""
    max_waiting: int | None = None
    """Most of them that are on their way from here, or wait."""
    memory_bytes: int | None = None
    """Most bytes that all take together that are on their way to here."""


class RosEntry(Entry, frozen=True, kw_only=True):
    """ROS 2, for all streams that are of it."""

    distro: str = DEFAULT_DISTRO
    """Whose interfaces, and whose form of keys."""
    domain: int | None = None
    """``ROS_DOMAIN_ID``; none: that of the environment, or 0."""
    namespace: str = ""
    """What names without a leading slash are in."""
    packages: str | None = None
    """Folder with the definitions of own packages, relative to the file's."""


class StreamRosEntry(Entry, frozen=True, kw_only=True):
    """ROS 2, for one stream."""

    stamp: str | None = None
    """What becomes of `header.stamp`; none: it crosses as it is."""


class StreamEntry(Entry, frozen=True, kw_only=True):
    """What topics, services and actions have in common."""

    id: int
    """Stream id, 1…175: the first byte of each record on the water."""
    priority: str = "data"
    """Zenoh's priority, in lower case."""
    linger_s: float = 0.0
    """How long a payload may wait for company in its frame, s."""
    encoding: str | None = None
    """Zenoh encoding on the application side."""
    codec: str | None = None
    """Codec on the water."""
    max_airtime: float | None = None
    """Share of the time that the stream may be on the air; none: no cap."""
    ros: StreamRosEntry | None = None
    """It is one of ROS 2, on rmw_zenoh; none: of Zenoh."""


class TopicEntry(StreamEntry, frozen=True, kw_only=True):
    """A topic."""

    topic: str
    """Key expression, with placeholders in braces."""
    type: str | None = None
    """Type of the samples; none: opaque bytes."""
    publishers: tuple[int, ...] | None = None
    """Addresses that may publish; none: any."""
    subscribers: tuple[int, ...] | None = None
    """Addresses that listen; none: all."""
    wildcards: tuple[WildcardEntry, ...] = ()
    """The placeholders of the topic, `{node}` excepted."""
    depth: int = 1
    """Samples kept per key while they wait."""
    lifespan_s: float | None = None
    """A sample older than this is not sent any more, s."""
    deadline_s: float | None = None
    """A sample of each key is promised at least so often, s."""
    min_interval_s: float = 0.0
    """Least time between two samples of one key on the water, s."""
    stamp: str = "none"
    """What tells the far side how old a sample is."""
    reliability: str = "best_effort"
    """ROS's word."""
    durability: str = "volatile"
    """ROS's word."""
    forward: str = "always"
    """When samples cross the water."""
    journal: bool = False
    """Samples survive a restart of this node."""
    max_bytes: int | None = None
    """Largest sample; none: as `objects` says."""
    exclusive: bool = False
    """Samples larger than a frame are sent without pauses."""


class ServiceEntry(StreamEntry, frozen=True, kw_only=True):
    """A service."""

    service: str
    """Key expression."""
    server: int
    """Address of the node that serves."""
    type: str | None = None
    """A ROS service, in place of `request` and `response`."""
    request: str | None = None
    """Type of a request; none: opaque bytes."""
    response: str | None = None
    """Type of a response; none: opaque bytes."""
    timeout_s: float = 60.0
    """Time after which a caller gives up, s."""
    journal: bool = True
    """Calls survive a restart of this node."""


class ActionEntry(StreamEntry, frozen=True, kw_only=True):
    """An action."""

    action: str
    """Key expression."""
    server: int
    """Address of the node that serves."""
    type: str | None = None
    """A ROS action, in place of `goal`, `feedback` and `result`."""
    goal: str | None = None
    """Type of a goal; none: opaque bytes."""
    feedback: str | None = None
    """Type of feedback; none: opaque bytes."""
    result: str | None = None
    """Type of a result; none: opaque bytes."""
    timeout_s: float = 60.0
    """Time after which a client gives up a goal that is not answered, s."""
    result_timeout_s: float = 3600.0
    """How long a result is kept for its client, and a client waits while it hears nothing, s."""
    feedback_interval_s: float = 0.0
    """Least time between two pieces of feedback on the water, s."""
    journal: bool = True
    """Goals survive a restart of this node."""


class RangingEntry(Entry, frozen=True, kw_only=True):
    """A range that is measured again and again."""

    to: int
    """Address of the node that is far away."""
    every_s: float
    """Time between two measurements, s."""
    by: int | None = None
    """Address of the node that measures; none: the node that reads the file."""


class Section(Entry, frozen=True, kw_only=True):
    """The section `plugins.acoustic`; streams are told apart later, by their keys."""

    address: int | None = None
    """Acoustic address of this node; may be given beside the file instead."""
    nodes: tuple[NodeEntry, ...] = ()
    """The fleet."""
    links: tuple[LinkEntry, ...] = ()
    """The modem; may be given beside the file instead."""
    types: tuple[TypeEntry, ...] = ()
    """Types that the streams and each other name."""
    journal: str | None = None
    """Folder of the journal, relative to the file's; none: nothing survives a restart."""
    streams: tuple[dict[str, Any], ...] = ()
    """What crosses the water."""
    model: str | None = None
    """File with the model of the dense streams, relative to the file's; none: they start anew."""
    ranging: tuple[RangingEntry, ...] = ()
    """Ranges that are measured again and again."""
    quiet: tuple[QuietEntry, ...] = ()
    """Hours of each day at which nothing is transmitted."""
    ros: RosEntry | None = None
    """ROS 2, for all streams that are of it."""
    overlays: tuple[Overlay, ...] = ()
    """Bounds, steps and constants for ROS types."""
    objects: ObjectsEntry | None = None
    """How much memory samples may take that are larger than a frame."""
    max_airtime: float | None = None
    """Share of the time that this node may be on the air; none: no cap."""
    orders_from: tuple[int, ...] | None = None
    """Addresses of the nodes whose orders over the water are obeyed; none: those of `nodes`."""
    heartbeat_s: float | None = None
    """How often each node is to be heard at least, s; none: no heartbeats."""
    lost_after_s: float | None = None
    """After how long without a sign of it a node counts as lost, s; none: never."""
    permit_log: str | None = None
    """File to which each emission is appended, relative to the file's; none: nowhere."""
    metrics: str | None = None
    """Where the gateway answers to Prometheus, PORT or HOST:PORT; none: nowhere."""


RECORDS: Final[dict[str, type[msgspec.Struct]]] = {
    "": Section,
    "nodes": NodeEntry,
    "links": LinkEntry,
    "types": TypeEntry,
    "fields": FieldSpec,
    "wildcards": WildcardEntry,
    "ranging": RangingEntry,
    "quiet": QuietEntry,
    "objects": ObjectsEntry,
    "ros": RosEntry,
    "streams.ros": StreamRosEntry,
    "overlays": Overlay,
    "overlays.fields": OverlayField,
}
"""The record of the table at a key, or of the entries of the list there; "" for the section. Where
a key means something else below another one, that one stands before it."""
