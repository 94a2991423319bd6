"""The gateway: a Zenoh session on one side, a link on the other; key expressions become streams.

`Gateway` is all that a program needs; `zacoustic gateway FILE` is it on the command line. One
module for each noun:

- `gateway`, `junction`, `exchange`: the life of it all; the session is a `zacoustic.zenoh.session`;
- `routes`, `jobs`: what is declared for each stream; `siblings`: who does it when there are several
  gateways on one local network;
- `streams`: topics, services and actions, both ways, and what late joiners get;
- `dialect`: what streams look like to Zenoh programs, and to nodes of ROS 2 (`ros`);
- `commands`: what is asked of the gateway itself;
- `status`, `complaints`, `notices`: what it says of itself and of the channel.
"""

from zacoustic.zenoh.gateway.gateway import Gateway
from zacoustic.zenoh.gateway.notices import Notice
from zacoustic.zenoh.session.marker import Marker, read_marker

__all__ = ["Gateway", "Marker", "Notice", "read_marker"]
