"""The gateway: a Zenoh session on one side, a link on the other; key expressions become streams.

`Gateway` is all that a program needs; `zacoustic gateway FILE` is it on the command line. One
module for each noun:

- `gateway`, `junction`, `exchange`: start and stop, the session joined to an engine, the event
  dispatcher; the session is a `zacoustic.zenoh.session`;
- `routes`, `jobs`: the declarations for each stream; `siblings`: which of several local gateways
  does a job;
- `streams`: topics, services and actions, both ways, and samples for late joiners;
- `dialect`: the forms of streams for Zenoh programs, and for nodes of ROS 2 (`ros`);
- `commands`: requests to the gateway itself;
- `status`, `complaints`, `notices`: its health, input errors and notices.
"""

from zacoustic.zenoh.gateway.gateway import Gateway
from zacoustic.zenoh.gateway.notices import Notice
from zacoustic.zenoh.session.marker import Marker, read_marker

__all__ = ["Gateway", "Marker", "Notice", "read_marker"]
