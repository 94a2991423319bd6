"""The delivery of a key as a Zenoh key: the query, and the JSON of its answer.

A `get` on ``@acoustic/3/key?source=5;within_s=120`` makes the local gateway send node 3 the key for
the broadcasts of node 5 (`zacoustic.core.transport.keydelivery`). No key is in query or answer.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.streams.keydelivery import KEYS_TIMEOUT_S
from zacoustic.text.digits import whole_number
from zacoustic.zenoh.session.asking.commands import ANY_NODE, PREFIX, node_in, time_limit_s

DEFAULT_DELIVERY_S: Final = 120.0
"""Default time limit of a delivery, s."""
DELIVERIES: Final = f"{PREFIX}/{ANY_NODE}/key"
"""Key expression of the deliveries to all nodes."""


class KeyAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a delivery."""

    address: int
    """The node that has the key now."""
    source: int
    """The node whose broadcasts it opens."""
    by: int
    """The node that has sent it."""
    airtime_s: float
    """Airtime of one frame with the key, s."""


class KeyAsked(msgspec.Struct, frozen=True, kw_only=True):
    """A delivery in a query."""

    node: int
    """Address of the receiving node."""
    source: int
    """The node whose broadcasts it is to open."""
    within_s: float = DEFAULT_DELIVERY_S
    """Time limit, s."""


def delivery_selector(node: int, source: int, within_s: float) -> tuple[str, str]:
    """Return key and parameters of a query."""
    return f"{PREFIX}/{node}/key", f"source={source};within_s={within_s:.10g}"


def read_delivery(key: str, parameters: Mapping[str, str]) -> KeyAsked | None:
    """Read a delivery.

    Returns:
        The delivery, or None: the key browses.

    Raises:
        ValueError: Names a parameter, its value and the allowed values.
    """
    node = node_in(key, "key")
    if node is None:
        return None
    source = 0
    for name, text in parameters.items():
        if name.startswith("_"):
            continue
        if name == "source":
            source = whole_number(text) or 0
        elif name != "within_s":
            raise ValueError(f"{name} is no parameter of {key}; allowed: source, within_s")
    if not 1 <= source <= 254:
        raise ValueError(f"source is {parameters.get('source', 'missing')}; allowed: 1..254")
    within_s = time_limit_s(parameters, DEFAULT_DELIVERY_S, KEYS_TIMEOUT_S)
    return KeyAsked(node=node, source=source, within_s=within_s)
