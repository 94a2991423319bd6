"""Names of ROS 2, and the keys of rmw_zenoh for them.

=====================================  ============================================================
ROS                                    rmw_zenoh
=====================================  ============================================================
topic or service ``/auv/cmd_vel``      ``DOMAIN/auv/cmd_vel/TYPE/HASH``
type ``geometry_msgs/msg/Twist``       ``geometry_msgs::msg::dds_::Twist_``
hash, of Humble                        ``TypeHashNotSupported``
hash, of later distributions           ``RIHS01_`` and 64 hexadecimal digits
=====================================  ============================================================

The name of a stream is that name without its leading slash. The number of chunks in a name varies,
so keys are read from both ends.
"""

import re
from typing import Final

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.text.digits import whole_number

NO_HASH: Final = "TypeHashNotSupported"
"""Humble's text in place of a hash."""

UNSTAMPED: Final = ".unstamped"
"""Suffix of the name of a type whose `header.stamp` does not cross."""

INTERFACE: Final = re.compile(r"[a-z][a-z0-9_]*/(msg|srv|action)/[A-Z][A-Za-z0-9_]*")
"""Full name of an interface."""

_CHUNK: Final = r"[A-Za-z_][A-Za-z0-9_]*"
_NAME: Final = re.compile(rf"/?({_CHUNK}|{{{_CHUNK}}})(/({_CHUNK}|{{{_CHUNK}}}))*")
_NAMESPACE: Final = re.compile(rf"/?({_CHUNK}(/{_CHUNK})*)?")


def is_interface(name: str) -> bool:
    """Return whether a text names a ROS interface: ``PACKAGE/msg|srv|action/Name``."""
    return INTERFACE.fullmatch(name) is not None


def stream_name(name: str, namespace: str = "") -> str:
    """Return the stream's name for a ROS name: the full name without its leading slash.

    Args:
        name: With a leading slash, or without: then it is in the namespace.
        namespace: With or without a leading slash.

    Raises:
        ConfigError: It is no ROS name.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f'"{name}"; allowed: a ROS name, such as "/auv/cmd_vel"',
            hint="letters, digits and _ between slashes; {node} may stand for the node's name",
        )
    space = check_namespace(namespace)
    if name.startswith("/") or not space:
        return name.lstrip("/")
    return f"{space}/{name}"


def check_namespace(namespace: str) -> str:
    """Return a namespace without its leading slash.

    Raises:
        ConfigError: It is invalid.
    """
    if not _NAMESPACE.fullmatch(namespace):
        raise ConfigError(f'"{namespace}"; allowed: a ROS namespace, such as "/auv1"')
    return namespace.strip("/")


def dds_type(interface: str) -> str:
    """Return the DDS name of a type: ``a/msg/B`` is ``a::msg::dds_::B_``."""
    package, kind, name = interface.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def interface_of(dds: str) -> str:
    """Return the type of a DDS name; if it is none, the text itself."""
    parts = dds.split("::")
    if len(parts) != 4 or parts[2] != "dds_" or not parts[3].endswith("_"):
        return dds
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"


class RosKey(msgspec.Struct, frozen=True, kw_only=True):
    """The key of a topic or a service in rmw_zenoh."""

    domain: int
    """``ROS_DOMAIN_ID``."""
    name: str
    """Full name without its leading slash."""
    type: str
    """DDS name of the type."""
    hash: str
    """Its hash, or `NO_HASH`."""

    def __str__(self) -> str:
        """The key."""
        return f"{self.domain}/{self.name}/{self.type}/{self.hash}"


def read_key(key: str) -> RosKey | None:
    """Read a key; None: it is not one of rmw_zenoh."""
    domain, _, rest = key.partition("/")
    chunks = rest.rsplit("/", 2)
    number = whole_number(domain)
    if len(chunks) != 3 or number is None or not all(chunks):
        return None
    return RosKey(domain=number, name=chunks[0], type=chunks[1], hash=chunks[2])
