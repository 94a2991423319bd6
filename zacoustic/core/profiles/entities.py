"""The entities of discovery: publishers, subscriptions, clients and services of a node."""

from enum import IntEnum

import msgspec


class EntityKind(IntEnum):
    """The kind of an entity; the numbers are those of the wire."""

    PUBLISHER = 0
    SUBSCRIPTION = 1
    CLIENT = 2
    SERVICE = 3


class DiscoverySpec(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of discovery."""

    beacon_id: int | None = None
    """Stream id of beacons, 1…255; None: none are sent or read."""
    request_id: int | None = None
    """Stream id of requests, 1…255; None: none are sent or answered."""
    node_name: str = "zacoustic"
    """Name of this node in its beacons."""


class RosEntitySeen(msgspec.Struct, frozen=True, kw_only=True):
    """A node of rmw_desert has announced an entity, or that one is gone."""

    node: str
    """Name of the node."""
    namespace: str
    """Its namespace."""
    kind: EntityKind
    """What it is."""
    gid: bytes
    """Identifies it."""
    topic: str
    """Topic or service; empty when it leaves."""
    type: str
    """Type of the samples; of requests for a client, of responses for a service; empty when it
    leaves."""
    leaves: bool
    """It is gone."""
    seen_at: int
    """Instant, ns."""
