"""The stream of carried samples, and who carries the samples of a topic.

`zacoustic.core.transport.carry` has the mechanism. Its stream is a reliable topic of which each key
is for one node: the value of its only wildcard is the address of that node. A table has it if one
of its topics is carried; like the stream of remote commands it is in no digest.
"""

from typing import Final

import msgspec

from zacoustic.core.base.clock import DURATIONS, is_duration
from zacoustic.core.streams.keys import MOST_VALUES, Wildcard
from zacoustic.errors import ConfigError

CARRY_STREAM_ID: Final = 0xAB
CARRY_NAME: Final = "carried/{to}"
FLEET_CARRY_NAME: Final = "{node}/carried/{to}"
"""Its name where nodes are listed: their list is in its digest then, so that nothing is taken of
another fleet with the same addresses."""
CARRY_WILDCARD: Final = Wildcard(name="to", values=tuple(map(str, range(MOST_VALUES))))
LONGEST_CARRY_S: Final = (15 << 15) * 60.0
"""The longest life of a carried sample, s: what its byte holds."""
LEAST_CARRY_S: Final = 60.0
MOST_CUSTODIANS: Final = 15
DEFAULT_AFTER_S: Final = 300.0
DEFAULT_EXPIRES_S: Final = 86400.0
DEFAULT_MAX_BYTES: Final = 64 << 20
"""How many bytes a node carries for others unless its config says otherwise."""


class Carry(msgspec.Struct, frozen=True, kw_only=True):
    """Who carries the samples of a topic to subscribers that its publisher does not reach."""

    by: tuple[int, ...]
    """Addresses of the custodians, the nearest to the subscribers first."""
    after_s: float = DEFAULT_AFTER_S
    """A node that was not heard for this time is out of reach, s."""
    expires_s: float = DEFAULT_EXPIRES_S
    """How long a sample is worth carrying, s: 60…29,491,200."""


def check_carry(carry: Carry) -> None:
    """Check who carries a topic, and for how long.

    Raises:
        ConfigError: A value is not allowed.
    """
    if not carry.by or len(carry.by) > MOST_CUSTODIANS:
        raise ConfigError(
            f"carry.by: {len(carry.by)} addresses; allowed: 1..{MOST_CUSTODIANS}",
            hint="name the nodes that take samples along, the nearest to the subscribers first",
        )
    for address in carry.by:
        if not 1 <= address <= 254:
            raise ConfigError(f"carry.by: {address}; allowed: addresses, 1..254")
        if carry.by.count(address) > 1:
            raise ConfigError(f"carry.by: {address} is there twice; allowed: once")
    if not is_duration(carry.after_s):
        raise ConfigError(f"carry.after_s: {carry.after_s}; allowed: above 0, {DURATIONS}")
    if not LEAST_CARRY_S <= carry.expires_s <= LONGEST_CARRY_S:
        allowed = f"{LEAST_CARRY_S:g}..{LONGEST_CARRY_S:g} s"
        raise ConfigError(f"carry.expires_s: {carry.expires_s}; allowed: {allowed}")
