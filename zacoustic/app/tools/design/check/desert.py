"""`check` of a configuration for rmw_desert: sizes of its packets, and its limits."""

from collections.abc import Callable, Iterator

from zacoustic.core.streams.rmwdesert import LAST_SEQUENCE
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.rmw_desert.messages import ITEMS_LIMIT, encode_head
from zacoustic.core.values.rmw_desert.packets import OVERHEAD_BYTES, PAYLOAD_LIMIT_BYTES
from zacoustic.core.values.rmw_desert.sizes import item_counts
from zacoustic.core.values.types import FieldSpec, TypeSpec

_KIND_BYTES = 1


def head_bytes(stream: Stream) -> int:
    """Return the bytes around a message's fields: packet, kind, id, and a call's sequence id."""
    is_call = isinstance(stream.spec, ServiceSpec)
    head = encode_head(stream.stream_id, LAST_SEQUENCE if is_call else None)
    return OVERHEAD_BYTES + _KIND_BYTES + len(head)


def notes(table: StreamTable) -> Iterator[str]:
    """Yield valid settings that deserve a warning."""
    for stream in table:
        for part, codec in _parts(stream):
            yield from _notes_of(
                f"stream {stream.stream_id} ({stream.name}), {part}", stream, codec
            )


def _parts(stream: Stream) -> Iterator[tuple[str, RmwDesertCodec]]:
    parts = {"topic": stream.codec}
    if isinstance(stream.spec, ServiceSpec):
        parts = {"request": stream.codec, "response": stream.response_codec}
    for part, codec in parts.items():
        if isinstance(codec, RmwDesertCodec):
            yield part, codec


def _notes_of(what: str, stream: Stream, codec: RmwDesertCodec) -> Iterator[str]:
    type_spec = codec.type_spec
    around_bytes = head_bytes(stream) - OVERHEAD_BYTES
    around_items = 3 if isinstance(stream.spec, ServiceSpec) else 2
    least, most = item_counts(type_spec)
    limit = (
        f"what has more than {ITEMS_LIMIT} items or {PAYLOAD_LIMIT_BYTES} bytes in a packet is "
        "refused here, and its receiver would cut it"
    )
    if (
        around_items + least > ITEMS_LIMIT
        or around_bytes + codec.smallest_bytes > PAYLOAD_LIMIT_BYTES
    ):
        yield f"{what}: even the smallest {type_spec.name} is too large: {limit}"
    elif (
        most is None
        or codec.largest_bytes is None
        or around_items + most > ITEMS_LIMIT
        or around_bytes + codec.largest_bytes > PAYLOAD_LIMIT_BYTES
    ):
        yield f"{what}: {limit}"
    path = _find(type_spec, lambda field: field.type == "bool" and field.is_bounded_array)
    if path:
        yield f"{what}: {path} is a sequence of booleans: it is read, and never sent from here"
    path = _find(type_spec, lambda field: field.type == "float64")
    if path:
        yield f"{what}: {path} is a float64, and crosses in single precision: seven digits"


def _find(type_spec: TypeSpec, is_it: Callable[[FieldSpec], bool]) -> str:
    """Return the path of the first field that meets a condition; empty: none does."""
    for field in type_spec.fields:
        path = f"{type_spec.name}.{field.name}"
        if is_it(field):
            return path
        inner = _find(type_spec.nested_type(field.type), is_it) if field.is_nested else ""
        if inner:
            return f"{path}.{inner.partition('.')[2]}"
    return ""
