"""The gateway: a Zenoh session on one side, a link on the other; key expressions become streams.

`Gateway` is all that a program needs; `zacoustic gateway FILE` is it on the command line. One
module for each noun:

- `gateway`, `junction`: the life of it all; the session is a `zacoustic.island`;
- `mailbox`: from Zenoh's threads to the loop, bounded;
- `routes`, `jobs`: what is declared for each stream; `siblings`, `presence`: who does it when there
  are several gateways on one island;
- `exchange`, `topics`, `services`, `actions`: samples, calls and goals, both ways; `lastvalues`;
- `latched`, `kept`: what late joiners get, and what of it is kept over a restart;
- `dialects`: what streams look like on the island, for Zenoh programs; `ros`: for nodes of ROS 2;
- `health`, `soundings`, `complaints`, `notices`: what it says of itself and of the water.
"""

from zacoustic.gateway.gateway import Gateway
from zacoustic.gateway.notices import Notice
from zacoustic.island.marker import Marker, read_marker

__all__ = ["Gateway", "Marker", "Notice", "read_marker"]
