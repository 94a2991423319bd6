"""The entities of discovery: publishers, subscriptions, clients and services of a node."""

from enum import IntEnum

import msgspec


class EntityKind(IntEnum):
    """The kind of an entity, with its number on the wire."""

    PUBLISHER = 0
    SUBSCRIPTION = 1
    CLIENT = 2
    SERVICE = 3


class DiscoverySpec(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of discovery."""

    beacon_id: int | None = None
    """Stream id of beacons, 1…255; None: no beacons are sent or read."""
    request_id: int | None = None
    """Stream id of requests, 1…255; None: no requests are sent or answered."""
    node_name: str = "zacoustic"
    """Name of this node in its beacons."""


class RosEntitySeen(msgspec.Struct, frozen=True, kw_only=True):
    """A node of rmw_desert has announced an entity, or that an entity is gone."""

    node: str
    """Name of the node."""
    namespace: str
    """Its namespace."""
    kind: EntityKind
    """Its kind."""
    gid: bytes
    """Its identifier."""
    topic: str
    """The topic or service; empty when it leaves."""
    type: str
    """The type of the samples, of a client's requests or of a service's responses; empty when it
    leaves."""
    leaves: bool
    """Whether it is gone."""
    seen_at: int
    """Instant of the announcement, ns."""
