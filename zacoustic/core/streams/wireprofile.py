"""Wire profiles: the set of frames that a node speaks on its link."""

import enum


class WireProfile(enum.Enum):
    """The wire of a stream table; the values are the words of the config."""

    NATIVE = "native"
    """docs/wire.md: nodes of zacoustic among themselves."""
    RMW_DESERT = "rmw_desert"
    """docs/rmw_desert.md: nodes with that ROS 2 middleware at the other end."""
