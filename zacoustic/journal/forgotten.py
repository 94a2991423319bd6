"""What a node without a journal forgets when it is restarted, in one line for people."""

from zacoustic.core.streams import ActionSpec, ServiceSpec, StreamTable, TopicSpec


def forgotten(table: StreamTable, address: int) -> str:
    """Say what this node does not keep over a restart without a journal.

    Args:
        table: The streams.
        address: This node.

    Returns:
        One line that names services and actions served here and topics that ask for a journal;
        empty when the table has none of them.
    """
    services, topics, actions = [], [], []
    for stream in table:
        spec = stream.spec
        if isinstance(spec, ServiceSpec) and spec.server == address and spec.journal:
            services.append(stream.name)
        elif isinstance(spec, ActionSpec) and spec.server == address and spec.journal:
            actions.append(stream.name)
        elif isinstance(spec, TopicSpec) and spec.journal:
            topics.append(stream.name)
    parts = []
    if services:
        parts.append(f"calls of {', '.join(services)} (one may run twice)")
    if actions:
        parts.append(f"goals of {', '.join(actions)} (one may run twice)")
    if topics:
        parts.append(f"samples of {', '.join(topics)}")
    return f"no journal, so a restart forgets {' and '.join(parts)}" if parts else ""
