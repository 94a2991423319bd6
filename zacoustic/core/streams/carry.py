"""The stream of carried samples, and who carries the samples of a topic.

`zacoustic.core.transport.carry` has the mechanism. Its stream is a reliable topic of which each key
is for one node: the value of its only wildcard is the address of that node. A table has it if one
of its topics is carried; like the stream of remote commands it is in no digest.
"""

from typing import Annotated, Final

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import Duration
from zacoustic.core.base.linktypes import Node
from zacoustic.core.streams.keys import MOST_VALUES, Wildcard
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import check_fields

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


_CUSTODIANS: Final = Meta(
    min_length=1,
    max_length=MOST_CUSTODIANS,
    description=f"1..{MOST_CUSTODIANS} addresses of nodes, each once",
    extra={
        "hint": "name the nodes that take samples along, the nearest to the subscribers first",
        "unique": True,
    },
)


class Carry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who carries the samples of a topic to subscribers that its publisher does not reach."""

    by: Annotated[tuple[Node, ...], _CUSTODIANS]
    """Addresses of the custodians, the nearest to the subscribers first."""
    after_s: Duration = DEFAULT_AFTER_S
    """A node that was not heard for this time is out of reach, s."""
    expires_s: Annotated[float, Meta(ge=LEAST_CARRY_S, le=LONGEST_CARRY_S, title="seconds")] = (
        DEFAULT_EXPIRES_S
    )
    """How long a sample is worth carrying, s."""

    def __post_init__(self) -> None:
        """Check each value.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        check_fields(self, ConfigError)
