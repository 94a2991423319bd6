"""Endpoints for programs: publish and subscribe, call and serve, with asyncio or without.

A `Node` lives on a link (one process, one modem, no Zenoh) or on the Zenoh network of its island;
the endpoints are the same. Modules, in reading order:

=========================  =========================================================================
`node`, `endpoints`        `Node`, which makes endpoints
`pubsub`, `service`,       the endpoints
`action`
`delivery`                 what becomes of a reliable sample
`form`                     classes ⇄ types
`catalogue`, `routes`,     names ⇄ streams
`agreement`
`carrier`                  what carries endpoints: the contract
`goals`                    the same for actions
`onlink`, `goalsonlink`    on a link
`onzenoh`, `session`,      on a Zenoh session, which is a `zacoustic.island`
`queries`, `crossing`,
`goalsonzenoh`
`identity`, `eventlog`     who the node is, what happens to it
`mailbox`                  what waits to be taken
`waiting`, `loopthread`,   the same without asyncio, for scripts and notebooks: the parts of
`waitingactions`           `zacoustic.blocking`
=========================  =========================================================================

Importing this package imports no Zenoh.
"""

from zacoustic.node.action import (
    ActionClient,
    ActionServer,
    ActionType,
    GoalHandle,
    GoalResult,
    ServerGoalHandle,
)
from zacoustic.node.carrier import NodeEvent
from zacoustic.node.delivery import Delivery
from zacoustic.node.node import Node
from zacoustic.node.pubsub import Publisher, Sample, Subscription
from zacoustic.node.service import CallContext, Client, Service, ServiceType

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
