"""ROS 2 on the local network: streams in the dialect of rmw_zenoh.

For local ROS nodes the gateway is another node, ``/acoustic_gateway_ADDRESS``, with an endpoint for
each remote endpoint. It declares them from the stream table and from other nodes' local tokens; no
token crosses the channel.

- `graph`: the gateway's node and endpoints, and those of other nodes;
- `dialects`: `RosDialects`, the ROS streams;
- `topics`, `latched`: samples; `services`: calls; `actions`: goals.
"""

from zacoustic.zenoh.gateway.dialect.ros.dialects import RosDialects

__all__ = ["RosDialects"]
