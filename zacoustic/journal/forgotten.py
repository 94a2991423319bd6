"""What a node without a journal forgets when it is restarted, in one line for people."""

from zacoustic.core.streams import ServiceSpec, StreamTable, TopicSpec


def forgotten(table: StreamTable, address: int) -> str:
    """Say what this node does not keep over a restart without a journal.

    Args:
        table: The streams.
        address: This node.

    Returns:
        One line that names services served here and topics that ask for a journal; empty when the
        table has none of them.
    """
    services, topics = [], []
    for stream in table:
        spec = stream.spec
        if isinstance(spec, ServiceSpec) and spec.server == address and spec.journal:
            services.append(stream.name)
        elif isinstance(spec, TopicSpec) and spec.journal:
            topics.append(stream.name)
    parts = []
    if services:
        parts.append(f"calls of {', '.join(services)} (one may run twice)")
    if topics:
        parts.append(f"samples of {', '.join(topics)}")
    return f"no journal, so a restart forgets {' and '.join(parts)}" if parts else ""
