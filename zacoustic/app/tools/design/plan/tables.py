"""Stream tables with other settings, for what a plan assumes or tries."""

from collections.abc import Callable, Collection, Mapping

import msgspec

from zacoustic.core.streams.specs import DENSE, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable

Respecify = Callable[[StreamSpec], StreamSpec]
"""Returns a stream with other settings."""


def respecified(table: StreamTable, changes: Mapping[int, Respecify]) -> StreamTable:
    """Return a table with other settings of some streams.

    A fitted model whose streams are no longer all dense is left out.

    Args:
        table: The table.
        changes: By stream id.

    Raises:
        ConfigError: A stream cannot have these settings.
    """
    specs = [
        changes[each.stream_id](each.spec) if each.stream_id in changes else each.spec
        for each in table
        if not each.is_built_in
    ]
    dense = {str(each.stream_id) for each in specs if each.codec == DENSE}
    model = table.model
    if model is not None and not dense.issuperset(map(str, model.streams)):
        model = None
    return StreamTable(specs, types=table.types, nodes=table.nodes, model=model, wire=table.wire)


def among(table: StreamTable, walked: Collection[int]) -> StreamTable:
    """Return a table whose fleet is some of its nodes: nobody waits for an answer of the others.

    Args:
        table: The table.
        walked: Addresses of the nodes.
    """
    left = {address: name for address, name in table.nodes.items() if address in walked}
    specs = [_among(each.spec, walked) for each in table if not each.is_built_in]
    return StreamTable(specs, types=table.types, nodes=left, model=table.model, wire=table.wire)


def _among(spec: StreamSpec, walked: Collection[int]) -> StreamSpec:
    if not isinstance(spec, TopicSpec):
        return spec
    ends = {
        key: None if listed is None else tuple(each for each in listed if each in walked)
        for key, listed in (("publishers", spec.publishers), ("subscribers", spec.subscribers))
    }
    return msgspec.structs.replace(spec, **ends)


def in_bytes(spec: StreamSpec, voices: int) -> StreamSpec:
    """Return a topic whose samples are bytes of a size: only the size of its values is known.

    Args:
        spec: The topic.
        voices: Number of nodes whose samples one of them may have to publish.
    """
    assert isinstance(spec, TopicSpec)
    qos = spec.qos
    if voices > 1:
        share = None if qos.max_airtime is None else min(1.0, qos.max_airtime * voices)
        depth = min(65_535, qos.depth * voices)
        # Its samples keep the interval already, each node's for itself.
        qos = msgspec.structs.replace(qos, min_interval_s=0.0, depth=depth, max_airtime=share)
    return msgspec.structs.replace(spec, type_name=None, codec="cbor", encoding=None, qos=qos)
