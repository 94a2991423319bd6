"""ROS 2 on the local network: streams in the dialect of rmw_zenoh.

To the local nodes the gateway is one node more, ``/acoustic_gateway_ADDRESS``, with an endpoint for
each remote endpoint. What it declares comes from the stream table, and from other nodes' tokens
here; nothing of it ever crosses the channel.

- `graph`: the own node and its endpoints, and those of others;
- `dialects`: `RosDialects`, the ROS streams;
- `topics`, `latched`: samples; `services`: calls; `actions`: goals.
"""

from zacoustic.zenoh.gateway.dialect.ros.dialects import RosDialects

__all__ = ["RosDialects"]
