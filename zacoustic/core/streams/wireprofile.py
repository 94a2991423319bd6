"""Wire profiles: the set of frames that a node speaks on its link."""

import enum


class WireProfile(enum.Enum):
    """The wire of a stream table; the values are the words of the configuration."""

    NATIVE = "native"
    """docs/wire.md: nodes of zacoustic among themselves."""
    RMW_DESERT = "rmw_desert"
    """docs/rmw_desert.md: nodes of that ROS 2 middleware are on the other side."""
