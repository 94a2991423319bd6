"""The gateway: a Zenoh session on one side, a link on the other; maps key expressions to streams.

A program needs only `Gateway`; `zacoustic run gateway FILE` runs one from the command line. The
modules:

- `gateway`, `compose`, `session`: start and stop, composition and run of the parts; the Zenoh
  session is a `zacoustic.zenoh.session`, the engine runs in a `zacoustic.run.node`;
- `network`: declarations on the local network for each stream (`jobs`), and other gateways there;
  `redundant`: which of several local gateways does a job;
- `events`: the event dispatcher, and what events say (`said`);
- `streams`: topics, services and actions, both ways, and samples for late joiners;
- `dialect`: the forms of streams for Zenoh programs and for nodes of ROS 2 (`ros`);
- `commands`: requests to the gateway itself;
- `lostcontact`: what the gateway does when its node hears nobody any more;
- `status`, `inputerrors`, `notices`: health, input errors and notices of the gateway.
"""

from zacoustic.zenoh.gateway.gateway import Gateway
from zacoustic.zenoh.gateway.notices import Notice
from zacoustic.zenoh.session.marker import Marker, read_marker

__all__ = ["Gateway", "Marker", "Notice", "read_marker"]
