"""Carried topics: what a node that has a part in one needs."""

from zacoustic.config.problems import Place
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable


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
                allowed=place.at("journal").allowed,
                hint="what a node has taken must survive its restart",
            )
