"""The table `carry`: how much a node carries for others."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import FOLDER_ALLOWED, CarryEntry
from zacoustic.core.streams.carry import DEFAULT_MAX_BYTES
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

_MOST_BYTES = 1 << 40


def read_carry(place: Place, entry: CarryEntry | None) -> int:
    """Return how much the node carries for others, bytes.

    Raises:
        ConfigError: It is out of its range.
    """
    if entry is None:
        return DEFAULT_MAX_BYTES
    if not 0 <= entry.max_bytes <= _MOST_BYTES:
        place.at("max_bytes").refuse(allowed=f"0..{_MOST_BYTES}")
    return entry.max_bytes


def check_carries_nothing(place: Place, table: StreamTable, own: int) -> None:
    """Check that a node without a journal has no part in a carried topic.

    Args:
        place: Place of the section.
        table: The streams.
        own: Address of the node.

    Raises:
        ConfigError: It publishes, carries or subscribes one.
    """
    for stream in table:
        spec = stream.spec
        if not isinstance(spec, TopicSpec) or spec.carry is None:
            continue
        if own in {*(spec.publishers or ()), *spec.carry.by, *(spec.subscribers or ())}:
            place.at("journal").refuse(
                f"is missing, and node {own} has a part in {stream.name}, which is carried",
                allowed=FOLDER_ALLOWED,
                hint="what a node has taken must survive its restart",
            )
