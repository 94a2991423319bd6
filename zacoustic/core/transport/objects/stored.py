"""The journal entries of objects, so that either end may crash at any instant.

==============================  ====================================================================
``object/out/7``                an outgoing object, with all that is needed to resume
``object/out/7/sent``           the fragment from which on nothing has been sent
``object/in/2/7/0``             fragments that arrived, in groups in the order of arrival
``object/done/2/7``             an object that was delivered: its digest and the fragments with it
==============================  ====================================================================

The second is written ahead of the transmission, in steps of a fortieth of the object, and the
groups of the third have a fortieth of it: so at most so much is sent again. The fourth is committed
before the object is delivered and confirmed: it is delivered once in any case. All of the third
stay until it has been delivered: a boot epoch that finds both delivers it, *again*, since the one
before may have died right behind that.
"""

from collections.abc import Iterator, Mapping

import msgspec

from zacoustic.core.streams.keys import Instance

_OUT = "object/out/"
_IN = "object/in/"
_DONE = "object/done/"
_SENT = "/sent"


class StoredObject(msgspec.Struct, frozen=True, array_like=True):
    """An outgoing object."""

    object_id: int
    stream_id: int
    instance: Instance
    encoding: str | None
    payload: bytes
    fragment_bytes: int
    receivers: tuple[int, ...]
    priority: int
    exclusive: bool
    lifespan_s: float | None
    lineage: int
    """Where it stands in the count of its key."""
    number: int
    stream_digest: bytes
    """Of the stream, as it was."""


class StoredProgress(msgspec.Struct, frozen=True, array_like=True):
    """From which fragment on nothing has been sent."""

    next_source: int
    next_seed: int


class StoredEnd(msgspec.Struct, frozen=True, array_like=True):
    """An object that was delivered."""

    digest: bytes
    head: tuple[bytes, ...]
    stream_digest: bytes = b""
    """Of the stream, as it was, where its fragments are kept until it is delivered."""


def out_key(transfer: int) -> str:
    """Return the key of an outgoing object."""
    return f"{_OUT}{transfer}"


def sent_key(transfer: int) -> str:
    """Return the key of how far it was sent."""
    return f"{_OUT}{transfer}{_SENT}"


def group_key(source: int, transfer: int, group: int) -> str:
    """Return the key of a group of fragments."""
    return f"{_IN}{source}/{transfer}/{group}"


def done_key(source: int, transfer: int) -> str:
    """Return the key of a delivered object."""
    return f"{_DONE}{source}/{transfer}"


def encode_group(fragments: list[tuple[int, bytes]]) -> bytes:
    """Encode fragments with their indices."""
    return msgspec.msgpack.encode(fragments)


def stored_out(
    stored: Mapping[str, bytes],
) -> Iterator[tuple[int, StoredObject, StoredProgress | None]]:
    """Yield the outgoing objects, by transfer number."""
    for key, value in stored.items():
        if key.startswith(_OUT) and not key.endswith(_SENT):
            transfer = int(key.removeprefix(_OUT))
            place = stored.get(sent_key(transfer))
            yield (
                transfer,
                msgspec.msgpack.decode(value, type=StoredObject),
                msgspec.msgpack.decode(place, type=StoredProgress) if place is not None else None,
            )


def stored_groups(
    stored: Mapping[str, bytes],
) -> Iterator[tuple[int, int, int, list[tuple[int, bytes]]]]:
    """Yield ``(source, transfer, group, fragments)`` in the order of arrival."""
    groups = []
    for key, value in stored.items():
        if key.startswith(_IN):
            source, transfer, group = map(int, key.removeprefix(_IN).split("/"))
            groups.append((source, transfer, group, value))
    for source, transfer, group, value in sorted(groups):
        yield source, transfer, group, msgspec.msgpack.decode(value, type=list[tuple[int, bytes]])


def stored_ends(stored: Mapping[str, bytes]) -> Iterator[tuple[int, int, StoredEnd]]:
    """Yield ``(source, transfer, end)`` of the objects that were delivered."""
    for key, value in stored.items():
        if key.startswith(_DONE):
            source, transfer = map(int, key.removeprefix(_DONE).split("/"))
            yield source, transfer, msgspec.msgpack.decode(value, type=StoredEnd)
