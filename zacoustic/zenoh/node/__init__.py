"""Endpoints for programs: publish and subscribe, call and serve, with asyncio or without.

A `Node` uses a link (one process, one modem, no Zenoh) or the local Zenoh network; its endpoints
are the same on both. In reading order:

- `api`: the node, its endpoints, from names to streams, and all of it without asyncio;
- `form`, `agreement`: from classes to types and back;
- `carrier`: the contract between endpoints and what carries their values; `routes`, `delivery`,
  `goals`, on `zacoustic.zenoh.ends`;
- `onlink`: a carrier with its own engine; `onzenoh`: a carrier that uses a gateway.

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
