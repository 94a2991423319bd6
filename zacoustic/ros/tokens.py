"""Liveliness tokens of rmw_zenoh, by which ROS nodes know of each other.

::

    @ros2_lv/DOMAIN/ZID/NODE/ID/NN/ENCLAVE/NAMESPACE/NAME
    @ros2_lv/DOMAIN/ZID/NODE/ID/MP|MS|SS|SC/ENCLAVE/NAMESPACE/NAME/TOPIC/TYPE/HASH/QOS

They announce a node, a publisher, a subscription, the server or a client of a service. A slash in a
part is written ``%``, and so is an empty part. There is no other announcement: samples of a
publisher without a token arrive, but nobody can list it, and a client waits for ever for a server
without a token.

The gid of an endpoint is the 128-bit XXH3 of its token, so the gid beside a message identifies its
sender.
"""

import enum
from typing import Final

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.ros.qos import RosQos, read_qos
from zacoustic.text.digits import whole_number
from zacoustic.text.installing import with_extra

PREFIX: Final = "@ros2_lv"
"""First chunk of all tokens; no wildcard of an application matches it."""
EXTRA_HINT: Final = with_extra("ros")
"""Advice if a package of the extra is missing."""

_SLASH: Final = "%"


class Entity(enum.Enum):
    """The kind of entity that a token announces."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVER = "SS"
    CLIENT = "SC"


class RosNode(msgspec.Struct, frozen=True, kw_only=True):
    """A node, as its session announces it."""

    domain: int
    """``ROS_DOMAIN_ID``."""
    zid: str
    """Id of its Zenoh session."""
    number: int
    """Number of the node in its session."""
    name: str
    """Its name."""
    namespace: str = "/"
    """Its namespace, with a leading slash."""
    enclave: str = "/"
    """Its enclave, with a leading slash."""


class Token(msgspec.Struct, frozen=True, kw_only=True):
    """One announcement."""

    node: RosNode
    """The node, or the endpoint's node."""
    number: int
    """Number of the entity in its session; for a node that of the node."""
    kind: Entity
    """Its kind."""
    topic: str = ""
    """Full name of the topic or service, with a leading slash; endpoints only."""
    type: str = ""
    """DDS name of its type; endpoints only."""
    hash: str = ""
    """Hash of the type; endpoints only."""
    qos: RosQos = RosQos()
    """Its QoS; endpoints only."""

    def __str__(self) -> str:
        """The key of the token."""
        node = self.node
        parts: list[object] = [
            PREFIX,
            node.domain,
            node.zid,
            node.number,
            self.number,
            self.kind.value,
            mangled(node.enclave),
            mangled(node.namespace),
            node.name,
        ]
        if self.kind is not Entity.NODE:
            parts += [mangled(self.topic), mangled(self.type), self.hash, self.qos]
        return "/".join(map(str, parts))

    @property
    def full_node_name(self) -> str:
        """Namespace and name of the node."""
        return f"{self.node.namespace.rstrip('/')}/{self.node.name}"


def read_token(key: str) -> Token | None:
    """Read the key of a token; None: it is none. Parts that newer versions append are ignored."""
    parts = key.split("/")
    if len(parts) < 9 or parts[0] != PREFIX:
        return None
    kinds = {each.value: each for each in Entity}
    kind = kinds.get(parts[5])
    domain, node_number, number = (whole_number(parts[index]) for index in (1, 3, 4))
    if kind is None or domain is None or node_number is None or number is None:
        return None
    node = RosNode(
        domain=domain,
        zid=parts[2],
        number=node_number,
        name=parts[8],
        namespace=unmangled(parts[7]),
        enclave=unmangled(parts[6]),
    )
    if kind is Entity.NODE:
        return Token(node=node, number=number, kind=kind)
    qos = read_qos(parts[12]) if len(parts) > 12 else None
    if qos is None:
        return None
    return Token(
        node=node,
        number=number,
        kind=kind,
        topic=unmangled(parts[9]),
        type=unmangled(parts[10]),
        hash=parts[11],
        qos=qos,
    )


def mangled(text: str) -> str:
    """Write a name as one chunk of a token."""
    return text.replace("/", _SLASH) or _SLASH


def unmangled(chunk: str) -> str:
    """Read a name that is one chunk of a token."""
    return chunk.replace(_SLASH, "/")


def gid_of(token: Token | str) -> bytes:
    """Return the gid of an endpoint, 16 bytes.

    Raises:
        ConfigError: `xxhash` is not installed.
    """
    try:
        from xxhash import xxh3_128_digest
    except ImportError as error:
        raise ConfigError("ROS 2 needs the package xxhash", hint=EXTRA_HINT) from error
    return xxh3_128_digest(str(token).encode())[::-1]
