"""What a node without a journal forgets at a restart, as one line of text."""

from zacoustic.core.base.qos import Durability
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile


def forgotten(table: StreamTable, address: int) -> str:
    """Name what this node loses at a restart without a journal.

    Args:
        table: The streams.
        address: This node.

    Returns:
        One line that names services and actions served here, topics that ask for a journal,
        on-demand topics published here, and latched ones heard here; empty when the table has none
        of them.
    """
    if table.wire is WireProfile.RMW_DESERT:
        return ""  # samples that are sent once are not journalled anyway
    services, topics, actions, demanded, latched = [], [], [], [], []
    for stream in table:
        spec = stream.spec
        if isinstance(spec, ServiceSpec) and spec.server == address and spec.journal:
            services.append(stream.name)
        elif isinstance(spec, ActionSpec) and spec.server == address and spec.journal:
            actions.append(stream.name)
        elif isinstance(spec, TopicSpec):
            may_hear = stream.may_subscribe(address) and spec.publishers != (address,)
            if spec.journal:
                topics.append(stream.name)
            if stream.is_on_demand and stream.may_publish(address):
                demanded.append(stream.name)
            if stream.qos.durability is Durability.TRANSIENT_LOCAL and may_hear:
                latched.append(stream.name)
    parts = []
    if services:
        parts.append(f"calls of {', '.join(services)} (one may run twice)")
    if actions:
        parts.append(f"goals of {', '.join(actions)} (one may run twice)")
    if topics:
        parts.append(f"samples of {', '.join(topics)}")
    if demanded:
        parts.append(
            f"the subscribers of {', '.join(demanded)} (until it publishes and they hear that)"
        )
    if latched:
        parts.append(
            f"what late joiners of {', '.join(latched)} get (until their publishers send it again)"
        )
    return f"no journal, so a restart forgets {' and '.join(parts)}" if parts else ""
