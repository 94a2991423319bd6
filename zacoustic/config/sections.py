"""The section as written: one record per table of the file, and the allowed values of each key.

The records hold the file's values and nothing else; `reading` interprets them. `ALLOWED` has the
allowed values of each key in words, for errors and for docs/reference.md.
"""

from typing import Any, Final

import msgspec

from zacoustic.core.base.linktypes import MAX_FRAME_S
from zacoustic.core.base.qos import PRIORITY_NAMES, Forward, Reliability, Stamp
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import LEAST_HEARTBEAT_S
from zacoustic.core.peers.ranging import LEAST_PERIOD_S, LONGEST_PERIOD_S
from zacoustic.core.schedule.access.spec import ScheduledSlot
from zacoustic.core.schedule.replybudget import REPLY_SHARE
from zacoustic.core.streams.carry import (
    DEFAULT_AFTER_S,
    DEFAULT_EXPIRES_S,
    DEFAULT_MAX_BYTES,
    LEAST_CARRY_S,
    LONGEST_CARRY_S,
)
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.encoding import TYPED_ENCODINGS
from zacoustic.core.values.types import SCALAR_TYPES, FieldSpec
from zacoustic.ros.interfaces import DEFAULT_DISTRO
from zacoustic.ros.overlays import Overlay, OverlayField
from zacoustic.seal.spec import (
    DEFAULT_OVERLAP_S,
    LARGEST_PAD_BYTES,
    LEAST_PAD_BYTES,
    LONGEST_OVERLAP_S,
    Mode,
    Seals,
    Strong,
)

ALLOWED: Final = {
    "address": "an address, 1..254",
    "id": "a number, 1..175",
    "name": "a text",
    "locator": 'a text, NAME/ADDRESS#key=value, such as "sim/127.0.0.1:7000"',
    "wire": ", ".join(f'"{profile.value}"' for profile in WireProfile),
    "allowed_topics": "a text, rmw_desert's file of topics, such as ros_allowed_topics.conf",
    "access": '{ method: "aloha" | "carrier_sense" | "tdma" | "schedule" | "polling" | '
    '"delegated" | "auto", … }; or "auto"',
    "method": "the name of a medium access",
    "slots": "a list of addresses; of a schedule, of { owners, for_s, range_m }",
    "owners": "a list of addresses",
    "for_s": "seconds, above 0",
    "range_m": "metres, 0 or more",
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
    "agreement": ", ".join(f'"{method.value}"' for method in AgreementMethod),
    "link": "the name of a link; of a stream also that of a route",
    "cost": '"free", "airtime", "money", or a price { per_byte, quantum }',
    "probe_s": "seconds, above 0",
    "down_after_s": "seconds, above 0",
    "default_links": "a list of names of links",
    "routes": "a list of { id, name, path }",
    "path": "2..16 addresses, from one end to the other, each once",
    "lifetime_s": "seconds, 0 or more",
    "relay": "{ max_airtime, queue }",
    "flood": "{ link, hops, max_airtime }; of a stream true, false",
    "hops": "a number, 1..4",
    "queue": "a number, 1..256",
    "links": "a list of { locator, … }, with a name each where there are several",
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
    "carry": "{ max_bytes }; of a topic { by, after_s, expires_s }",
    "after_s": "seconds, above 0",
    "expires_s": f"seconds, {LEAST_CARRY_S:g}..{LONGEST_CARRY_S:g}",
    "max_airtime": "a share, above 0, at most 1",
    "max_frame_s": "seconds, 0.5..600",
    "port": "0..127, another one for each link, and the same at both ends",
    "commands_from": "a list of addresses; [] for nobody",
    "permit_log": "a text, the file to append to",
    "metrics": 'a text, "PORT" or "HOST:PORT"',
    "metrics_names": 'a list of host names, such as ["auv1.example"]',
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
    "model": "a file that `zacoustic codec fit` has made",
    "reliability": ", ".join(reliability.value for reliability in Reliability),
    "durability": '"volatile", "transient_local"',
    "local_publishers": "a number, 1..255",
    "codec": '"cbor", "packed", for topics "dense"',
    "forward": ", ".join(forward.value for forward in Forward),
    "heartbeat_s": f"seconds, {LEAST_HEARTBEAT_S:g} or more",
    "lost_after_s": "seconds, above 0",
    "lost_contact": "a list of { name, lost_after_s, call } or { name, lost_after_s, publish }",
    "of": "a list of addresses of other nodes",
    "call": "a text, the key of a service on the local network",
    "publish": "a text, a key of the local network",
    "value": "a value",
    "range": "a list of two numbers, [low, high]",
    "step": 'a number above 0, or a ratio as "1/60000"',
    "unit": "a text",
    "wraps": "true, false",
    "outside": "reject, clamp, escape",
    "nan": "true, false",
    "optional": "true, false",
    "length": "a number, 1..65535",
    "max_length": "a number, 1..65535",
    "min_length": "a number, 1..65535",
    "default": "a value of the field's type",
    "security": "{ key, members, mode, seal, strong, pad, overlap_s, reply_share, lives, "
    "emergency }",
    "key": "a text, the key file that `zacoustic key new` has made",
    "members": "a text, the list that `zacoustic key new --identity` has made",
    "mode": ", ".join(mode.value for mode in Mode),
    "strong": f"a list of {', '.join(each.value for each in Strong)}",
    "seal": "transmit, receive",
    "pad": f"a list of lengths of frames, {LEAST_PAD_BYTES}..{LARGEST_PAD_BYTES}, ascending",
    "overlap_s": f"seconds, 0..{LONGEST_OVERLAP_S:.0f}",
    "reply_share": "a share, above 0, at most 1",
    "lives": "a text, the folder of the life records",
    "emergency": "{ unsealed }",
    "unsealed": "a list of names of topics",
    "ranging": "a list of { to, every_s }",
    "to": "the address of another node",
    "by": "the address of a node; of carry a list of addresses",
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
"""Allowed values of each key, in words."""

FOLDER_ALLOWED: Final = "a text, the folder of the journal"
"""Allowed values of the key `journal` of the section."""

FIELD_TYPE_ALLOWED: Final = f"{', '.join(SCALAR_TYPES)}, or the name of a type"
"""Allowed values of the key `type` of a field."""

ZENOH_KEYS: Final = ("__required__", "__path__", "__plugin__")
"""Keys of the section for Zenoh's plugin loader, not for us."""


class Entry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file; an unknown key is an error."""


class NodeEntry(Entry, frozen=True, kw_only=True):
    """One node of the fleet."""

    address: int
    """Acoustic address, 1…254."""
    name: str
    """Name, one chunk of a key; replaces `{node}` in a topic."""
    heartbeat_s: float | None = None
    """Longest silence of the node, s; default: the section's value."""
    lost_after_s: float | None = None
    """The node is lost when not heard for this long, s; default: the section's value."""


class LinkEntry(Entry, frozen=True, kw_only=True):
    """One modem."""

    locator: str
    """Link, address and settings: ``NAME/ADDRESS#key=value``."""
    name: str | None = None
    """Name of the link, for streams and reports; a single link needs none."""
    wire: str = WireProfile.NATIVE.value
    """Wire profile."""
    allowed_topics: str | None = None
    """rmw_desert's file of topics and ids, relative to this file; default: the streams have ids."""
    access: dict[str, Any] | str | None = None
    """Medium access, read by `zacoustic.config.access`, or "auto", the default."""
    max_airtime: float | None = None
    """Share of the time that this node may be on the air on this link; default: the section's."""
    max_frame_s: float | None = None
    """Longest airtime of a frame on this link, s; default: the section's."""
    port: int | None = None
    """Number of the link in sealed frames, the same at all nodes; default: its place in the
    list."""
    owners: tuple[int, ...] | None = None
    """Addresses of the nodes that have it; default: all. Several nodes may each have an entry with
    the same name and another locator."""
    cost: dict[str, Any] | str | None = None
    """What a frame costs, for lists of links: `"free"`, `"airtime"`, the default, `"money"`, or the
    price of a byte and what a frame is rounded up to: `{ per_byte: 0.0032, quantum: 50 }`."""
    probe_s: float | None = None
    """Pause between two tries of the link when it reaches nobody, s; default: 5 s where frames are
    free, else 600 s."""
    down_after_s: float | None = None
    """Silence after which the next link of a list is used, s; default: 3 s where frames are free,
    else 600 s."""


class RouteEntry(Entry, frozen=True, kw_only=True):
    """A line of nodes over which frames go from one end to the other, and back."""

    id: int
    """Number of the route on the channel, the same at all nodes."""
    name: str
    """Name of the link that the route is for its two ends."""
    path: tuple[int, ...]
    """Addresses of the nodes, from one end to the other."""
    link: str | None = None
    """Name of the link of all hops; default: the first one."""
    lifetime_s: float = 0.0
    """A frame that has been on its way for longer is dropped, s; 0: 60 s for each hop."""
    probe_s: float | None = None
    """As of a link, for lists that name the route; default: 600 s."""
    down_after_s: float | None = None
    """As of a link, for lists that name the route; default: 600 s."""


class RelayEntry(Entry, frozen=True, kw_only=True):
    """How much the node does for the routes of others."""

    max_airtime: float = 0.2
    """Share of the time that it transmits frames of others."""
    queue: int = 16
    """How many frames of others it holds at most."""


class FloodEntry(Entry, frozen=True, kw_only=True):
    """How frames of streams with `flood: true` go, equal in the fleet but for `max_airtime`."""

    link: str | None = None
    """Name of the link of all hops; default: the first one."""
    hops: int = 3
    """How many hops they go at most."""
    max_airtime: float = 0.05
    """Share of the time that this node passes frames of others on."""


class TypeEntry(Entry, frozen=True, kw_only=True):
    """One type, defined here, in Python, or both."""

    name: str
    """Name for streams and fields."""
    fields: tuple[FieldSpec, ...] | None = None
    """The fields in their order on the wire."""
    python: str | None = None
    """``module:Class`` of a `msgspec.Struct`."""


class WildcardEntry(Entry, frozen=True, kw_only=True):
    """A placeholder of a topic and its values."""

    name: str
    """Name between the braces."""
    values: tuple[str, ...]
    """Key chunks; the position crosses the channel."""


class QuietEntry(Entry, frozen=True, kw_only=True, rename={"begin": "from", "end": "to"}):
    """Hours of each day in which the node transmits nothing."""

    begin: str
    """Time of day in UTC, ``HH:MM``; `from` in the file."""
    end: str
    """Time of day in UTC, ``HH:MM``; `to` in the file."""


class ObjectsEntry(Entry, frozen=True, kw_only=True):
    """Bounds of the memory for samples larger than a frame."""

    max_bytes: int | None = None
    """Largest sample that the node sends or accepts, bytes."""
    max_waiting: int | None = None
    """Most outgoing objects under way or waiting."""
    memory_bytes: int | None = None
    """Most bytes of all incoming objects together."""


class CarryEntry(Entry, frozen=True, kw_only=True):
    """How much this node carries for others."""

    max_bytes: int = DEFAULT_MAX_BYTES
    """Most bytes of samples of other nodes."""


class RosEntry(Entry, frozen=True, kw_only=True):
    """ROS 2, for all ROS streams."""

    distro: str = DEFAULT_DISTRO
    """ROS 2 distribution: its interfaces and its form of keys."""
    domain: int | None = None
    """``ROS_DOMAIN_ID``; default: the environment's, or 0."""
    namespace: str = ""
    """Namespace of names without a leading slash."""
    packages: str | None = None
    """Folder with the definitions of your own packages, relative to this file."""


class StreamRosEntry(Entry, frozen=True, kw_only=True):
    """ROS 2, for one stream."""

    stamp: str | None = None
    """Treatment of `header.stamp`; default: it crosses unchanged."""


class StreamEntry(Entry, frozen=True, kw_only=True):
    """The common keys of topics, services and actions."""

    id: int
    """Stream id, 1…175: the first byte of each record."""
    priority: str = "data"
    """Zenoh's priority, in lower case."""
    linger_s: float = 0.0
    """How long a payload may wait for others in its frame, s."""
    encoding: str | None = None
    """Zenoh encoding on the application side."""
    codec: str | None = None
    """Codec on the channel."""
    outside: str = "reject"
    """Treatment of values that are more than the type says, for fields that say nothing."""
    max_airtime: float | None = None
    """Share of the time for which the stream may be on the air; default: no cap."""
    link: str | None = None
    """Name of the link that carries the stream; default: the first one."""
    links: tuple[str, ...] | None = None
    """Names of links: each frame goes by the first that reaches its receivers."""
    flood: bool = False
    """Every node passes its frames on, for emergencies."""
    ros: StreamRosEntry | None = None
    """A ROS 2 stream on rmw_zenoh; default: a Zenoh stream."""


class CarriedEntry(Entry, frozen=True, kw_only=True):
    """Who carries a topic to subscribers that its publisher does not reach."""

    by: tuple[int, ...]
    """Nodes that take samples along, the nearest to the subscribers first."""
    after_s: float = DEFAULT_AFTER_S
    """A node is out of reach when not heard for this long, s."""
    expires_s: float = DEFAULT_EXPIRES_S
    """How long a sample is worth carrying, s."""


class TopicEntry(StreamEntry, frozen=True, kw_only=True):
    """A topic."""

    topic: str
    """Key expression, with placeholders in braces."""
    type: str | None = None
    """Type of the samples; default: opaque bytes."""
    publishers: tuple[int, ...] | None = None
    """Addresses that may publish; default: any."""
    subscribers: tuple[int, ...] | None = None
    """Addresses that subscribe; default: all."""
    wildcards: tuple[WildcardEntry, ...] = ()
    """The placeholders of the topic, `{node}` excepted."""
    depth: int = 1
    """Samples of a key that may wait."""
    lifespan_s: float | None = None
    """Age above which a sample is not sent any more, s."""
    deadline_s: float | None = None
    """Longest period between two samples of a key, s: a promise."""
    min_interval_s: float = 0.0
    """Minimum time between two transmitted samples of one key, s."""
    stamp: str = "none"
    """How the far side learns a sample's age."""
    reliability: str = "best_effort"
    """Best effort or reliable, as in ROS."""
    durability: str = "volatile"
    """Volatile or transient-local, as in ROS."""
    local_publishers: int = 1
    """Publishers of a node with a depth of their own, of a latched topic; with `ros`: 4."""
    forward: str = "always"
    """When samples cross the channel."""
    journal: bool = False
    """Samples survive a restart of this node."""
    max_bytes: int | None = None
    """Largest sample, bytes; default: that of `objects`."""
    exclusive: bool = False
    """Samples larger than a frame are sent without pauses."""
    carry: CarriedEntry | None = None
    """Who carries samples to subscribers out of reach; default: nobody."""


class ServiceEntry(StreamEntry, frozen=True, kw_only=True):
    """A service."""

    service: str
    """Key expression."""
    server: int
    """Address of the node that serves."""
    type: str | None = None
    """A ROS service, in place of `request` and `response`."""
    request: str | None = None
    """Type of a request; default: opaque bytes."""
    response: str | None = None
    """Type of a response; default: opaque bytes."""
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
    """Type of a goal; default: opaque bytes."""
    feedback: str | None = None
    """Type of feedback; default: opaque bytes."""
    result: str | None = None
    """Type of a result; default: opaque bytes."""
    timeout_s: float = 60.0
    """Time after which a client gives up a goal without an answer, s."""
    result_timeout_s: float = 3600.0
    """How long a server keeps a result, and a client waits while it hears nothing, s."""
    feedback_interval_s: float = 0.0
    """Minimum time between two transmitted feedbacks of a goal, s."""
    journal: bool = True
    """Goals survive a restart of this node."""


class RangingEntry(Entry, frozen=True, kw_only=True):
    """A range that a node measures periodically."""

    to: int
    """Address of the other node."""
    every_s: float
    """Time between two measurements, s."""
    by: int | None = None
    """Address of the measuring node; default: the node that reads the file."""


class LostContactEntry(Entry, frozen=True, kw_only=True):
    """What a gateway does when its node hears nobody any more."""

    name: str
    """Name of the entry, one chunk of a key."""
    lost_after_s: float
    """Silence after which contact is lost, s."""
    of: tuple[int, ...] | None = None
    """A frame of any of these nodes is contact; default: of any other node."""
    call: str | None = None
    """Service on the local network to call then, until it answers."""
    publish: str | None = None
    """Key of the local network to publish then, until somebody subscribes to it."""
    value: Any = None
    """Request of the call, or the sample; default: an empty payload."""
    encoding: str | None = None
    """Encoding of the value; default: CBOR. A service of `streams` has its own."""
    timeout_s: float = 10.0
    """How long to wait for an answer before the next call, s."""
    by: int | None = None
    """Address of the node that acts; default: the node that reads the file."""


class EmergencyEntry(Entry, frozen=True, kw_only=True):
    """What a node accepts from senders without a key."""

    unsealed: tuple[str, ...] = ()
    """Best-effort topics accepted in frames without a seal, too: anybody can send them."""


class SecurityEntry(Entry, frozen=True, kw_only=True):
    """The seal of frames."""

    key: str
    """Key file of the fleet, or identity of this node, relative to this file."""
    members: str | None = None
    """List of members, if nodes have identities; default: `key` is the fleet's."""
    mode: str = Mode.ENCRYPT.value
    """Whether frames are encrypted, or readable for everybody; nobody can forge either."""
    seal: str = Seals.ALL.value
    """Whether the node transmits; if not, it needs no journal."""
    strong: tuple[str, ...] = tuple(each.value for each in Strong)
    """Frames that get a tag of eight bytes in place of four."""
    pad: tuple[int, ...] | None = None
    """The only lengths of frames, bytes; default: no padding."""
    overlap_s: float = DEFAULT_OVERLAP_S
    """How long after its start a node opens frames of the former generation of the key, s."""
    reply_share: float = REPLY_SHARE
    """Share of the time that replies to each other node may take; see docs/security.md."""
    lives: str = "lives"
    """Folder of the life records, relative to this file; never copy or restore it."""
    emergency: EmergencyEntry | None = None
    """What a node accepts from senders without a key; default: nothing."""


class Section(Entry, frozen=True, kw_only=True):
    """The section `plugins.acoustic`."""

    address: int | None = None
    """Acoustic address of this node; `--address` overrides it."""
    nodes: tuple[NodeEntry, ...] = ()
    """The fleet."""
    agreement: str | None = None
    """How nodes learn that they share a table: `"confirm"` for few nodes, `"tag"` for many;
    default: `"confirm"`."""
    links: tuple[LinkEntry, ...] = ()
    """The modems, the first one for streams that name none; `--link` overrides them."""
    routes: tuple[RouteEntry, ...] = ()
    """Routes over other nodes, equal in the fleet."""
    relay: RelayEntry | None = None
    """How much this node does for the routes of others."""
    flood: FloodEntry | None = None
    """How frames go that every node passes on."""
    default_links: tuple[str, ...] = ()
    """As `links` of a stream, for streams that name none, and for remote commands; default: the
    first link."""
    types: tuple[TypeEntry, ...] = ()
    """Types for streams and for other types."""
    journal: str | None = None
    """Folder of the journal, relative to this file; default: nothing survives a restart."""
    streams: tuple[dict[str, Any], ...] = ()
    """The streams that cross the channel."""
    model: str | None = None
    """File with the model of the dense streams, relative to this file; default: no model."""
    ranging: tuple[RangingEntry, ...] = ()
    """Ranges that nodes measure periodically."""
    quiet: tuple[QuietEntry, ...] = ()
    """Hours of each day in which the node transmits nothing."""
    ros: RosEntry | None = None
    """ROS 2, for all ROS streams."""
    overlays: tuple[Overlay, ...] = ()
    """Bounds, steps and constants for ROS types."""
    objects: ObjectsEntry | None = None
    """Bounds of the memory for samples larger than a frame."""
    carry: CarryEntry | None = None
    """How much this node carries for others."""
    max_airtime: float | None = None
    """Share of the time that this node may be on the air, on each link; default: no cap but the
    fair share."""
    max_frame_s: float = MAX_FRAME_S
    """Longest airtime of a frame, s: an emergency waits for the frame under way. Frames of 32 bytes
    may take longer."""
    commands_from: tuple[int, ...] | None = None
    """Nodes whose remote commands this node executes; default: those of `nodes`."""
    heartbeat_s: float | None = None
    """Longest silence of each node, s; default: no heartbeats."""
    lost_after_s: float | None = None
    """A node is lost when not heard for this long, s; default: never."""
    lost_contact: tuple[LostContactEntry, ...] = ()
    """What the gateways do when they hear nobody any more."""
    security: SecurityEntry | None = None
    """The seal of frames; default: frames are neither encrypted nor authenticated."""
    permit_log: str | None = None
    """File to which the node appends each emission, relative to this file; default: none."""
    metrics: str | None = None
    """Where the gateway answers Prometheus, PORT or HOST:PORT; default: nowhere."""
    metrics_names: tuple[str, ...] = ()
    """Host names under which Prometheus finds it, besides this computer's own and addresses."""


RECORDS: Final[dict[str, type[msgspec.Struct]]] = {
    "": Section,
    "nodes": NodeEntry,
    "links": LinkEntry,
    "slots": ScheduledSlot,
    "routes": RouteEntry,
    "relay": RelayEntry,
    "flood": FloodEntry,
    "types": TypeEntry,
    "fields": FieldSpec,
    "wildcards": WildcardEntry,
    "ranging": RangingEntry,
    "lost_contact": LostContactEntry,
    "quiet": QuietEntry,
    "objects": ObjectsEntry,
    "streams.carry": CarriedEntry,
    "carry": CarryEntry,
    "security": SecurityEntry,
    "emergency": EmergencyEntry,
    "ros": RosEntry,
    "streams.ros": StreamRosEntry,
    "overlays": Overlay,
    "overlays.fields": OverlayField,
}
"""Record of the table at a key, or of the entries of its list; "" for the section. If a key has
another meaning below another key, that one stands before it."""
