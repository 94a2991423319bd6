"""ROS 2 on the island: streams in the dialect of rmw_zenoh.

To the nodes of the island the gateway is one node more, ``/acoustic_gateway_ADDRESS``, with an
endpoint for whatever lives beyond the water. What it declares comes from the stream table, and from
what it hears of other nodes' tokens here; nothing of it ever crosses the water.

- `graph`: the own node and its endpoints, and what is seen of others;
- `dialects`: `RosDialects`, which streams are of ROS;
- `topics`, `latched`: samples; `services`: calls; `actions`: goals.
"""

from zacoustic.zenoh.gateway.dialect.ros.dialects import RosDialects

__all__ = ["RosDialects"]
