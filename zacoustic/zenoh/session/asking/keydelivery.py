"""The delivery of a key as a Zenoh key: the query, and the JSON of its answer.

A `get` on ``@acoustic/3/key?source=5;within_s=120`` makes the local gateway send node 3 the key for
the broadcasts of node 5 (`zacoustic.core.transport.keydelivery`). No key is in query or answer.
"""

import math
from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.streams.keydelivery import KEYS_TIMEOUT_S
from zacoustic.text.digits import real_number, whole_number
from zacoustic.zenoh.session.asking.commands import ANY_NODE, PREFIX

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


def receiving_node(key: str) -> int | None:
    """Read the receiving node from a key; None: the key browses."""
    chunks = key.split("/")
    if len(chunks) != 3 or chunks[0] != PREFIX or chunks[2] != "key":
        return None
    return whole_number(chunks[1])


def read_delivery(key: str, parameters: Mapping[str, str]) -> KeyAsked | None:
    """Read a delivery.

    Returns:
        The delivery, or None: the key browses.

    Raises:
        ValueError: Names a parameter, its value and the allowed values.
    """
    node = receiving_node(key)
    if node is None:
        return None
    source, within_s = 0, DEFAULT_DELIVERY_S
    for name, text in parameters.items():
        if name.startswith("_"):
            continue
        if name == "source":
            source = whole_number(text) or 0
        elif name == "within_s":
            number = real_number(text)
            within_s = math.nan if number is None else number
        else:
            raise ValueError(f"{name} is no parameter of {key}; allowed: source, within_s")
    if not 1 <= source <= 254:
        raise ValueError(f"source is {parameters.get('source', 'missing')}; allowed: 1..254")
    if not 0 < within_s <= KEYS_TIMEOUT_S:
        allowed = f"seconds above 0, at most {KEYS_TIMEOUT_S:g}"
        raise ValueError(f"within_s is {parameters['within_s']}; allowed: {allowed}")
    return KeyAsked(node=node, source=source, within_s=within_s)
