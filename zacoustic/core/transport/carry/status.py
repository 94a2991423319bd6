"""What a node keeps of carried topics, for who watches it."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import msgspec

from zacoustic.core.transport.carry.custody import Held


class CarriedSums(msgspec.Struct, frozen=True, kw_only=True):
    """How much a node keeps of one carried topic."""

    own: dict[int, int] = {}
    """By subscriber, how many samples of this node it is not known to have."""
    custodians: dict[int, int] = {}
    """By custodian, how many of these it has as well."""
    carried: dict[int, int] = {}
    """By subscriber, how many samples of other nodes are kept for it."""
    carried_bytes: int = 0
    """Their size, bytes."""


class CarriedStream(CarriedSums, frozen=True, kw_only=True):
    """The same with the topic and its instants."""

    stream_id: int
    """The topic."""
    oldest_at: int | None
    """When the first of all was published or taken here, ns; None: unknown until the link is up."""
    ends_at: int | None
    """When the first of all is worthless, ns; None: unknown until the link is up."""


class CarrySums(msgspec.Struct, frozen=True, kw_only=True):
    """How much a node keeps for the next hop, of all topics."""

    own: int = 0
    """Samples of this node that some subscriber lacks."""
    in_custody: int = 0
    """How many of these a custodian has as well."""
    carried: int = 0
    """Samples of other nodes."""
    carried_bytes: int = 0
    """Their size, bytes."""
    max_bytes: int = 0
    """How large they may be together, bytes."""
    refused: int = 0
    """Samples of other nodes that there was no room for, since the start."""
    expired: int = 0
    """Samples of other nodes that have become worthless here, since the start."""


class CarryStatus(CarrySums, frozen=True, kw_only=True):
    """The same with what is kept of each topic."""

    streams: tuple[CarriedStream, ...]
    """The same by topic, of those of which something is kept."""


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
        expired=sum(each.expired for each in parts),
        streams=tuple(stream for each in parts for stream in each.streams),
    )


def streams_of(samples: Iterable[Held], *, is_dated: bool) -> Iterator[CarriedStream]:
    """Yield what is kept of each topic, in the order of their ids.

    Args:
        samples: What is kept.
        is_dated: Whether their instants are of this run of the clock.
    """
    by_stream: dict[int, list[Held]] = {}
    for held in samples:
        by_stream.setdefault(held.envelope.bundle.stream_id, []).append(held)
    for stream_id, kept in sorted(by_stream.items()):
        own = [held for held in kept if held.delivery_id is not None]
        others = [held for held in kept if held.delivery_id is None]
        since = [held.kept_at for held in kept if held.kept_at is not None]
        yield CarriedStream(
            stream_id=stream_id,
            own=_count(held.envelope.bundle.destination for held in own),
            custodians=_count(each.custodian for each in own if each.custodian is not None),
            carried=_count(held.envelope.bundle.destination for held in others),
            carried_bytes=sum(held.envelope.size_bytes for held in others),
            oldest_at=min(since, default=None) if is_dated else None,
            ends_at=min(held.ends_at for held in kept) if is_dated else None,
        )


def _count(addresses: Iterable[int]) -> dict[int, int]:
    """Return how often each address is there, in the order of the addresses."""
    return dict(sorted(Counter(addresses).items()))
