"""What a node keeps of carried topics, for who watches it."""

from collections.abc import Sequence

import msgspec


class CarryStatus(msgspec.Struct, frozen=True, kw_only=True):
    """What a node keeps for the next hop."""

    own: int
    """Samples of this node that some subscriber lacks."""
    in_custody: int
    """How many of these a custodian has as well."""
    carried: int
    """Samples of other nodes."""
    carried_bytes: int
    """Their size, bytes."""
    max_bytes: int
    """How large they may be together, bytes."""
    refused: int
    """Samples of other nodes that there was no room for, since the start."""


def sum_of(parts: Sequence[CarryStatus]) -> CarryStatus | None:
    """Return the sum of what is kept on each link; None: no topic is carried."""
    if not parts:
        return None
    return CarryStatus(
        own=sum(each.own for each in parts),
        in_custody=sum(each.in_custody for each in parts),
        carried=sum(each.carried for each in parts),
        carried_bytes=sum(each.carried_bytes for each in parts),
        max_bytes=parts[0].max_bytes,
        refused=sum(each.refused for each in parts),
    )
