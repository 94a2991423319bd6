"""Keys and encoding of a stream in the local network: Zenoh's own, or those of ROS 2."""
