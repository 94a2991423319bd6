"""The section as written: one record per table of the file.

Each field states what its key may be: the type, the range, the words (`zacoustic.text.allowed`).
Reading, errors, docs/reference.md and the schema of editors follow from that. The records hold the
file's values and nothing else; `reading` interprets them, and checks what needs two keys. Marks
say what a value refers to: `refers`, the list of the section that must have it ("own": this node,
of `nodes` or of an argument); `unique`, that a list has it once; and `once`, the keys whose values
no two tables of a list share.
"""

from typing import Annotated, Any, Final, Literal, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import LONGEST_S, Duration, DurationOrZero, Share
from zacoustic.core.base.linktypes import MAX_FRAME_S, Address, Node, Nodes
from zacoustic.core.base.qos import (
    PRIORITY_NAMES,
    Deadline,
    Depth,
    Durability,
    Forward,
    Reliability,
    Stamp,
)
from zacoustic.core.bond.spec import LinkCost, Tariff
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import LEAST_HEARTBEAT_S
from zacoustic.core.peers.ranging import LEAST_PERIOD_S, LONGEST_PERIOD_S
from zacoustic.core.relay.flood import Hops
from zacoustic.core.relay.relay import RelayRules
from zacoustic.core.relay.route import RouteId, RoutePath
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.schedule.replybudget import REPLY_SHARE
from zacoustic.core.streams.carry import DEFAULT_MAX_BYTES, Carry
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import LAST_STREAM_ID, Codec, Publishers, StreamOutside
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.transport.objects.limits import ObjectBytes, ObjectMemory, Transfers
from zacoustic.core.values.encoding import TYPED_ENCODINGS
from zacoustic.core.values.types import FieldSpec
from zacoustic.core.wire.seal import LAST_PORT
from zacoustic.ros.interfaces import DEFAULT_DISTRO
from zacoustic.ros.overlays import Overlay
from zacoustic.seal.spec import (
    DEFAULT_OVERLAP_S,
    LARGEST_PAD_BYTES,
    LEAST_PAD_BYTES,
    LONGEST_OVERLAP_S,
    Mode,
    Seals,
    Strong,
)
from zacoustic.text.allowed import one_of

ZENOH_KEYS: Final = ("__required__", "__path__", "__plugin__")
"""Keys of the section for Zenoh's plugin loader, not for us."""


def _file(words: str) -> Meta:
    """Return the declaration of the name of a file or folder."""
    return Meta(pattern=r"^[^\0]+$", description=f"a text, {words}")


def _nodes(words: str, leave_out: str) -> Meta:
    """Return the declaration of a list of nodes, each once."""
    extra = {"unique": True, "hint": f"leave it out{leave_out}"}
    return Meta(min_length=1, title=words, extra=extra)


_CHUNK: Final = Meta(
    pattern=r"^(?!@)[^/*$?#{}]+$", description="one chunk of a key, without / * $ ? # { }"
)
_LINK_CHUNK: Final = Meta(
    pattern="^[^/@*$?#{}]+$", description="one chunk of a key, without / @ * $ ? # { }"
)
_FIT: Final = Meta(
    extra={"hint": "`zacoustic codec fit RECORDING --config FILE --output MODEL` makes one"}
)
_LINK: Final = Meta(description="the name of a link", extra={"refers": "links"})
_WAY: Final = Meta(description="the name of a link or a route", extra={"refers": "ways"})
_TYPE: Final = Meta(title="a text, the name of a type")
_KEY: Final = Meta(title="a text, a key expression")
_TIME: Final = Meta(
    pattern=r"^([01][0-9]|2[0-3]):[0-5][0-9]$(?!\n)",
    description='a time of day in UTC, "00:00" to "23:59"',
)
_Name: TypeAlias = Annotated[str, _CHUNK]
_Heartbeat: TypeAlias = Annotated[float, Meta(ge=LEAST_HEARTBEAT_S, le=LONGEST_S, title="seconds")]
_FrameTime: TypeAlias = Annotated[float, Meta(ge=0.5, le=600, title="seconds")]
_Publishers: TypeAlias = Annotated[
    tuple[Node, ...], _nodes("a list of addresses of nodes", " for all nodes")
]
_Ways: TypeAlias = Annotated[
    tuple[Annotated[str, _WAY], ...],
    Meta(min_length=1, title="a list of names of links, each once", extra={"unique": True}),
]
_HOST: Final = Meta(
    pattern=r"^[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*$(?!\n)",
    description='a host name, such as "auv1.example"',
)
_Encoding: TypeAlias = Annotated[
    str, Meta(title=f"a text, for typed streams one of {', '.join(TYPED_ENCODINGS)}")
]
RosDomain: TypeAlias = Annotated[int, Meta(ge=0, le=232)]
"""``ROS_DOMAIN_ID``."""
StreamId: TypeAlias = Annotated[
    int,
    Meta(
        ge=1,
        description=f"a number, 1..{LAST_STREAM_ID}",
        extra_json_schema={"maximum": LAST_STREAM_ID},  # the other wire has more, and checks them
    ),
]
"""Number of a stream: the first byte of each record."""
_Codec: TypeAlias = Annotated[
    str, one_of(("cbor", "packed")), Meta(extra={"hint": "topics can be dense"})
]


class Entry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file; an unknown key is an error."""


class NodeEntry(Entry, frozen=True, kw_only=True):
    """One node of the fleet."""

    address: Address
    """Acoustic address."""
    name: _Name
    """Name, one chunk of a key; replaces `{node}` in a topic."""
    heartbeat_s: _Heartbeat | None = None
    """Longest silence of the node, s; default: the section's value."""
    lost_after_s: Duration | None = None
    """The node is lost when not heard for this long, s; default: the section's value."""


class LinkEntry(Entry, frozen=True, kw_only=True):
    """One modem."""

    locator: Annotated[
        str,
        Meta(
            pattern="^/*[^/#]+/",
            description='a text, NAME/ADDRESS#key=value, such as "sim/127.0.0.1:7000"',
        ),
    ]
    """Link, address and settings: ``NAME/ADDRESS#key=value``."""
    name: Annotated[str, _LINK_CHUNK] | None = None
    """Name of the link, for streams and reports; a single link needs none."""
    wire: Annotated[str, one_of(each.value for each in WireProfile)] = WireProfile.NATIVE.value
    """Wire profile."""
    allowed_topics: (
        Annotated[str, _file("rmw_desert's file of topics, such as ros_allowed_topics.conf")] | None
    ) = None
    """rmw_desert's file of topics and ids, relative to this file; default: the streams have ids."""
    access: AccessSpec | Literal["auto"] | None = None
    """Medium access, or "auto", the default."""
    max_airtime: Share | None = None
    """Share of the time that this node may be on the air on this link; default: the section's."""
    max_frame_s: _FrameTime | None = None
    """Longest airtime of a frame on this link, s; default: the section's."""
    port: Annotated[int, Meta(ge=0, le=LAST_PORT)] | None = None
    """Number of the link in sealed frames, the same at all nodes; default: its place in the
    list."""
    owners: Nodes | None = None
    """Addresses of the nodes that have it; default: all. Several nodes may each have an entry with
    the same name and another locator."""
    cost: LinkCost | Tariff | None = None
    """What a frame costs, for lists of links: `"free"`, `"airtime"`, the default, `"money"`, or the
    price of a byte and what a frame is rounded up to: `{ per_byte: 0.0032, quantum: 50 }`."""
    probe_s: Duration | None = None
    """Pause between two tries of the link when it reaches nobody, s; default: 5 s where frames are
    free, else 600 s."""
    down_after_s: Duration | None = None
    """Silence after which the next link of a list is used, s; default: 3 s where frames are free,
    else 600 s."""


class RouteEntry(Entry, frozen=True, kw_only=True):
    """A line of nodes over which frames go from one end to the other, and back."""

    id: RouteId
    """Number of the route on the channel, the same at all nodes."""
    name: Annotated[str, _LINK_CHUNK]
    """Name of the link that the route is for its two ends."""
    path: RoutePath
    """Addresses of the nodes, from one end to the other."""
    link: Annotated[str, _LINK] | None = None
    """Name of the link of all hops; default: the first one."""
    lifetime_s: DurationOrZero = 0.0
    """A frame that has been on its way for longer is dropped, s; 0: 60 s for each hop."""
    probe_s: Duration | None = None
    """As of a link, for lists that name the route; default: 600 s."""
    down_after_s: Duration | None = None
    """As of a link, for lists that name the route; default: 600 s."""


class FloodEntry(Entry, frozen=True, kw_only=True):
    """How frames of streams with `flood: true` go, equal in the fleet but for `max_airtime`."""

    link: Annotated[str, _LINK] | None = None
    """Name of the link of all hops; default: the first one."""
    hops: Hops = 3
    """How many hops they go at most."""
    max_airtime: Share = 0.05
    """Share of the time that this node passes frames of others on."""


class TypeEntry(Entry, frozen=True, kw_only=True):
    """One type, defined here, in Python, or both."""

    name: str
    """Name for streams and fields."""
    fields: Annotated[tuple[FieldSpec, ...], Meta(title="a list of { name, type, … }")] | None = (
        None
    )
    """The fields in their order on the wire."""
    python: (
        Annotated[str, Meta(pattern="^[^.:][^:]*:.", description='a text, "module:Class"')] | None
    ) = None
    """``module:Class`` of a `msgspec.Struct`."""


class QuietEntry(Entry, frozen=True, kw_only=True, rename={"begin": "from", "end": "to"}):
    """Hours of each day in which the node transmits nothing."""

    begin: Annotated[str, _TIME]
    """Time of day in UTC, ``HH:MM``; `from` in the file."""
    end: Annotated[str, _TIME]
    """Time of day in UTC, ``HH:MM``; `to` in the file."""


class ObjectsEntry(Entry, frozen=True, kw_only=True):
    """Bounds of the memory for samples larger than a frame."""

    max_bytes: ObjectBytes | None = None
    """Largest sample that the node sends or accepts, bytes."""
    max_waiting: Transfers | None = None
    """Most outgoing objects under way or waiting."""
    memory_bytes: ObjectMemory | None = None
    """Most bytes of all incoming objects together."""


class CarryEntry(Entry, frozen=True, kw_only=True):
    """How much this node carries for others."""

    max_bytes: Annotated[int, Meta(ge=0, le=1 << 40, title="a number of bytes")] = DEFAULT_MAX_BYTES
    """Most bytes of samples of other nodes."""


class RosEntry(Entry, frozen=True, kw_only=True):
    """ROS 2, for all ROS streams."""

    distro: Annotated[str, Meta(title="the name of a ROS 2 distribution")] = DEFAULT_DISTRO
    """ROS 2 distribution: its interfaces and its form of keys."""
    domain: RosDomain | None = None
    """``ROS_DOMAIN_ID``; default: the environment's, or 0."""
    namespace: Annotated[str, Meta(title='a ROS namespace, such as "/auv1"')] = ""
    """Namespace of names without a leading slash."""
    packages: (
        Annotated[str, _file("a folder of PACKAGE/msg/Name.msg, PACKAGE/srv/Name.srv and so on")]
        | None
    ) = None
    """Folder with the definitions of your own packages, relative to this file."""


class StreamRosEntry(Entry, frozen=True, kw_only=True):
    """ROS 2, for one stream."""

    stamp: Annotated[str, one_of(("exact", "drop", "age"))] | None = None
    """Treatment of `header.stamp`; default: it crosses unchanged."""


class StreamEntry(Entry, frozen=True, kw_only=True):
    """The common keys of topics, services and actions."""

    id: StreamId
    """Stream id: the first byte of each record."""
    priority: Annotated[str, one_of(PRIORITY_NAMES)] = "data"
    """Zenoh's priority, in lower case."""
    linger_s: DurationOrZero = 0.0
    """How long a payload may wait for others in its frame, s."""
    encoding: _Encoding | None = None
    """Zenoh encoding on the application side."""
    codec: _Codec | None = None
    """Codec on the channel."""
    outside: StreamOutside = "reject"
    """Treatment of values that are more than the type says, for fields that say nothing."""
    max_airtime: Share | None = None
    """Share of the time for which the stream may be on the air; default: no cap."""
    link: Annotated[str, _WAY] | None = None
    """Name of the link that carries the stream; default: the first one."""
    links: _Ways | None = None
    """Names of links: each frame goes by the first that reaches its receivers."""
    flood: bool = False
    """Every node passes its frames on, for emergencies."""
    ros: StreamRosEntry | None = None
    """A ROS 2 stream on rmw_zenoh; default: a Zenoh stream."""


class TopicEntry(StreamEntry, frozen=True, kw_only=True):
    """A topic."""

    codec: Codec | None = None
    """Codec on the channel."""
    topic: Annotated[str, _KEY]
    """Key expression, with placeholders in braces."""
    type: Annotated[str, _TYPE] | None = None
    """Type of the samples; default: opaque bytes."""
    publishers: _Publishers | None = None
    """Addresses that may publish; default: any."""
    subscribers: _Publishers | None = None
    """Addresses that subscribe; default: all."""
    wildcards: tuple[Wildcard, ...] = ()
    """The placeholders of the topic, `{node}` excepted."""
    depth: Depth = 1
    """Samples of a key that may wait."""
    lifespan_s: Duration | None = None
    """Age above which a sample is not sent any more, s."""
    deadline_s: Deadline | None = None
    """Longest period between two samples of a key, s: a promise."""
    min_interval_s: DurationOrZero = 0.0
    """Minimum time between two transmitted samples of one key, s."""
    stamp: Stamp = Stamp.NONE
    """How the far side learns a sample's age."""
    reliability: Reliability = Reliability.BEST_EFFORT
    """Best effort or reliable, as in ROS."""
    durability: Durability = Durability.VOLATILE
    """Volatile or transient-local, as in ROS."""
    local_publishers: Publishers = 1
    """Publishers of a node with a depth of their own, of a latched topic; with `ros`: 4."""
    forward: Forward = Forward.ALWAYS
    """When samples cross the channel."""
    journal: bool = False
    """Samples survive a restart of this node."""
    max_bytes: ObjectBytes | None = None
    """Largest sample, bytes; default: that of `objects`."""
    exclusive: bool = False
    """Samples larger than a frame are sent without pauses."""
    carry: Carry | None = None
    """Who carries samples to subscribers out of reach; default: nobody."""


class ServiceEntry(StreamEntry, frozen=True, kw_only=True):
    """A service."""

    service: Annotated[str, _KEY]
    """Key expression."""
    server: Node
    """Address of the node that serves."""
    type: Annotated[str, _TYPE] | None = None
    """A ROS service, in place of `request` and `response`."""
    request: Annotated[str, _TYPE] | None = None
    """Type of a request; default: opaque bytes."""
    response: Annotated[str, _TYPE] | None = None
    """Type of a response; default: opaque bytes."""
    timeout_s: Duration = 60.0
    """Time after which a caller gives up, s."""
    journal: bool = True
    """Calls survive a restart of this node."""


class ActionEntry(StreamEntry, frozen=True, kw_only=True):
    """An action."""

    action: Annotated[str, _KEY]
    """Key expression."""
    server: Node
    """Address of the node that serves."""
    type: Annotated[str, _TYPE] | None = None
    """A ROS action, in place of `goal`, `feedback` and `result`."""
    goal: Annotated[str, _TYPE] | None = None
    """Type of a goal; default: opaque bytes."""
    feedback: Annotated[str, _TYPE] | None = None
    """Type of feedback; default: opaque bytes."""
    result: Annotated[str, _TYPE] | None = None
    """Type of a result; default: opaque bytes."""
    timeout_s: Duration = 60.0
    """Time after which a client gives up a goal without an answer, s."""
    result_timeout_s: Duration = 3600.0
    """How long a server keeps a result, and a client waits while it hears nothing, s."""
    feedback_interval_s: DurationOrZero = 0.0
    """Minimum time between two transmitted feedbacks of a goal, s."""
    journal: bool = True
    """Goals survive a restart of this node."""


STREAMS: Final[dict[str, type[StreamEntry]]] = {
    "topic": TopicEntry,
    "service": ServiceEntry,
    "action": ActionEntry,
}
"""Record of a stream by the key that tells its kind."""
_STREAM: Final = Meta(
    description="{ id, topic, … }, { id, service, … } or { id, action, … }",
    extra={"tables": STREAMS},
)


class RangingEntry(Entry, frozen=True, kw_only=True):
    """A range that a node measures periodically."""

    to: Annotated[Node, Meta(title="the address of another node")]
    """Address of the other node."""
    every_s: Annotated[float, Meta(ge=LEAST_PERIOD_S, le=LONGEST_PERIOD_S, title="seconds")]
    """Time between two measurements, s."""
    by: Node | None = None
    """Address of the measuring node; default: the node that reads the file."""


class LostContactEntry(Entry, frozen=True, kw_only=True):
    """What a gateway does when its node hears nobody any more."""

    name: _Name
    """Name of the entry, one chunk of a key."""
    lost_after_s: Duration
    """Silence after which contact is lost, s."""
    of: (
        Annotated[
            tuple[Node, ...],
            _nodes(
                "a list of addresses of other nodes", ", and a frame of any other node is contact"
            ),
        ]
        | None
    ) = None
    """A frame of any of these nodes is contact; default: of any other node."""
    call: Annotated[str, Meta(title="a text, the key of a service on the local network")] | None = (
        None
    )
    """Service on the local network to call then, until it answers."""
    publish: Annotated[str, Meta(title="a text, a key of the local network")] | None = None
    """Key of the local network to publish then, until somebody subscribes to it."""
    value: Any = None
    """Request of the call, or the sample; default: an empty payload."""
    encoding: Annotated[str, one_of(TYPED_ENCODINGS)] | None = None
    """Encoding of the value; default: CBOR. A service of `streams` has its own."""
    timeout_s: Duration = 10.0
    """How long to wait for an answer before the next call, s."""
    by: Node | None = None
    """Address of the node that acts; default: the node that reads the file."""


class EmergencyEntry(Entry, frozen=True, kw_only=True):
    """What a node accepts from senders without a key."""

    unsealed: Annotated[tuple[str, ...], Meta(title="a list of names of topics")] = ()
    """Best-effort topics accepted in frames without a seal, too: anybody can send them."""


class SecurityEntry(Entry, frozen=True, kw_only=True):
    """The seal of frames."""

    key: Annotated[str, _file("the key file that `zacoustic key new` has made")]
    """Key file of the fleet, or identity of this node, relative to this file."""
    members: (
        Annotated[str, _file("the list that `zacoustic key new --identity` has made")] | None
    ) = None
    """List of members, if nodes have identities; default: `key` is the fleet's."""
    mode: Mode = Mode.ENCRYPT
    """Whether frames are encrypted, or readable for everybody; nobody can forge either."""
    seal: Seals = Seals.ALL
    """Whether the node transmits; if not, it needs no journal."""
    strong: tuple[Strong, ...] = tuple(Strong)
    """Frames that get a tag of eight bytes in place of four."""
    pad: (
        Annotated[
            tuple[Annotated[int, Meta(ge=LEAST_PAD_BYTES, le=LARGEST_PAD_BYTES)], ...],
            Meta(description="a list of lengths of frames, ascending"),
        ]
        | None
    ) = None
    """The only lengths of frames, bytes; default: no padding."""
    overlap_s: Annotated[float, Meta(ge=0, le=LONGEST_OVERLAP_S, title="seconds")] = (
        DEFAULT_OVERLAP_S
    )
    """How long after its start a node opens frames of the former generation of the key, s."""
    reply_share: Share = REPLY_SHARE
    """Share of the time that replies to each other node may take; see docs/security.md."""
    lives: Annotated[str, _file("the folder of the life records")] = "lives"
    """Folder of the life records, relative to this file; never copy or restore it."""
    emergency: EmergencyEntry | None = None
    """What a node accepts from senders without a key; default: nothing."""


class Section(Entry, frozen=True, kw_only=True):
    """The section `plugins.acoustic`."""

    address: Annotated[Address, Meta(extra={"refers": "own"})] | None = None
    """Acoustic address of this node; `--address` overrides it."""
    nodes: Annotated[tuple[NodeEntry, ...], Meta(extra={"once": ("address", "name")})] = ()
    """The fleet."""
    agreement: AgreementMethod | None = None
    """How nodes learn that they share a table: `"confirm"` for few nodes, `"tag"` for many;
    default: `"confirm"`."""
    links: tuple[LinkEntry, ...] = ()
    """The modems, the first one for streams that name none; `--link` overrides them."""
    routes: Annotated[tuple[RouteEntry, ...], Meta(extra={"once": ("id", "name")})] = ()
    """Routes over other nodes, equal in the fleet."""
    relay: RelayRules | None = None
    """How much this node does for the routes of others."""
    flood: FloodEntry | None = None
    """How frames go that every node passes on."""
    default_links: _Ways = ()
    """As `links` of a stream, for streams that name none, and for remote commands; default: the
    first link."""
    types: Annotated[
        tuple[TypeEntry, ...], Meta(title="a list of { name, fields } or { name, python }")
    ] = ()
    """Types for streams and for other types."""
    journal: Annotated[str, _file("the folder of the journal")] | None = None
    """Folder of the journal, relative to this file; default: nothing survives a restart."""
    streams: tuple[Annotated[dict[str, Any], _STREAM], ...] = ()
    """The streams that cross the channel."""
    model: Annotated[str, _file("the file that `zacoustic codec fit` has made"), _FIT] | None = None
    """File with the model of the dense streams, relative to this file; default: no model."""
    ranging: tuple[RangingEntry, ...] = ()
    """Ranges that nodes measure periodically."""
    quiet: Annotated[
        tuple[QuietEntry, ...], Meta(title='a list of { from: "22:00", to: "06:00" }')
    ] = ()
    """Hours of each day in which the node transmits nothing."""
    ros: RosEntry | None = None
    """ROS 2, for all ROS streams."""
    overlays: tuple[Overlay, ...] = ()
    """Bounds, steps and constants for ROS types."""
    objects: ObjectsEntry | None = None
    """Bounds of the memory for samples larger than a frame."""
    carry: CarryEntry | None = None
    """How much this node carries for others."""
    max_airtime: Share | None = None
    """Share of the time that this node may be on the air, on each link; default: no cap but the
    fair share."""
    max_frame_s: _FrameTime = MAX_FRAME_S
    """Longest airtime of a frame, s: an emergency waits for the frame under way. Frames of 32 bytes
    may take longer."""
    commands_from: (
        Annotated[tuple[Node, ...], Meta(title="a list of addresses of nodes; [] for nobody")]
        | None
    ) = None
    """Nodes whose remote commands this node executes; default: those of `nodes`."""
    heartbeat_s: _Heartbeat | None = None
    """Longest silence of each node, s; default: no heartbeats."""
    lost_after_s: Duration | None = None
    """A node is lost when not heard for this long, s; default: never."""
    lost_contact: Annotated[
        tuple[LostContactEntry, ...],
        Meta(
            title="a list of { name, lost_after_s, call } or { name, lost_after_s, publish }",
            extra={"once": ("name",)},
        ),
    ] = ()
    """What the gateways do when they hear nobody any more."""
    security: SecurityEntry | None = None
    """The seal of frames; default: frames are neither encrypted nor authenticated."""
    permit_log: Annotated[str, _file("the file to append to")] | None = None
    """File to which the node appends each emission, relative to this file; default: none."""
    metrics: Annotated[str, Meta(description='a text, "PORT" or "HOST:PORT"')] | None = None
    """Where the gateway answers Prometheus, PORT or HOST:PORT; default: nowhere."""
    metrics_names: tuple[Annotated[str, _HOST], ...] = ()
    """Host names under which Prometheus finds it, besides this computer's own and addresses."""
