"""Endpoints for programs: publish and subscribe, call and serve, with asyncio or without.

A `Node` lives on a link (one process, one modem, no Zenoh) or on the Zenoh network of its island;
the endpoints are the same. Modules, in reading order:

=========================  =========================================================================
`node`, `endpoints`        `Node`, which makes endpoints
`pubsub`, `service`        the endpoints
`form`                     classes ⇄ types
`catalogue`, `routes`      names ⇄ streams
`carrier`                  what carries endpoints: the contract
`onlink`                   on a link
`onzenoh`, `session`,      on a Zenoh session, which is a `zacoustic.island`
`queries`, `crossing`
`identity`, `eventlog`     who the node is, what happens to it
`mailbox`                  what waits to be taken
`blocking`, `waiting`,     the same without asyncio, for scripts and notebooks
`loopthread`
=========================  =========================================================================

Importing this package imports no Zenoh.
"""

from zacoustic.node.carrier import NodeEvent
from zacoustic.node.node import Node
from zacoustic.node.pubsub import Publisher, Sample, Subscription
from zacoustic.node.service import CallContext, Client, Service, ServiceType

__all__ = [
    "CallContext",
    "Client",
    "Node",
    "NodeEvent",
    "Publisher",
    "Sample",
    "Service",
    "ServiceType",
    "Subscription",
]
