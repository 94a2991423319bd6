"""The gateway: a Zenoh session on one side, a link on the other; key expressions become streams.

`Gateway` is all that a program needs; `zacoustic gateway FILE` is it on the command line. One
module for each noun:

- `gateway`, `compose`, `session`: start and stop, what the parts are made of, how they run; the
  Zenoh session is a `zacoustic.zenoh.session`, the engine runs in a `zacoustic.run.node`;
- `network`: what is declared there for each stream (`jobs`), and who else is there; `redundant`:
  which of several local gateways does a job;
- `events`: the event dispatcher, and what people are told of an event;
- `streams`: topics, services and actions, both ways, and samples for late joiners;
- `dialect`: the forms of streams for Zenoh programs, and for nodes of ROS 2 (`ros`);
- `commands`: requests to the gateway itself;
- `status`, `input_errors`, `notices`: its health, input errors and notices.
"""

from zacoustic.zenoh.gateway.gateway import Gateway
from zacoustic.zenoh.gateway.notices import Notice
from zacoustic.zenoh.session.marker import Marker, read_marker

__all__ = ["Gateway", "Marker", "Notice", "read_marker"]
