"""Endpoints for programs: publish and subscribe, call and serve, with asyncio or without.

A `Node` uses a link (one process, one modem, no Zenoh) or the local Zenoh network; the endpoints
are the same. In reading order:

- `api`: the node, which makes endpoints, and the endpoints; names to streams; without asyncio;
- `form`, `agreement`: classes to types and back;
- `carrier`: what an endpoint needs of the carrier of its values; `routes`, `delivery`, `goals`;
- `onlink`: with its own engine; `onzenoh`: by a gateway.

Importing this package imports no Zenoh.
"""

from zacoustic.zenoh.node.api.action import (
    ActionClient,
    ActionServer,
    ActionType,
    GoalHandle,
    GoalResult,
    ServerGoalHandle,
)
from zacoustic.zenoh.node.api.node import Node
from zacoustic.zenoh.node.api.pubsub import Publisher, Sample, Subscription
from zacoustic.zenoh.node.api.service import CallContext, Client, Service, ServiceType
from zacoustic.zenoh.node.carrier import NodeEvent
from zacoustic.zenoh.node.delivery import Delivery

__all__ = [
    "ActionClient",
    "ActionServer",
    "ActionType",
    "CallContext",
    "Client",
    "Delivery",
    "GoalHandle",
    "GoalResult",
    "Node",
    "NodeEvent",
    "Publisher",
    "Sample",
    "ServerGoalHandle",
    "Service",
    "ServiceType",
    "Subscription",
]
