"""The journal entries of objects, so that either end may crash at any instant.

==============================  ====================================================================
``object/out/7``                an outgoing object, with all that is needed to resume it
``object/out/7/sent``           the fragment from which on none has been sent
``object/in/2/7/0``             fragments that arrived, in groups in the order of arrival
``object/age/2/7``              how old an object was when its first fragment had arrived
``object/done/2/7``             an object that was delivered: its digest and the fragments with it
==============================  ====================================================================

The second entry is written ahead of the transmission, in steps of a fortieth of the object, and
each group of the third has a fortieth of it: so at most a fortieth is sent again after a crash. The
last entry is committed before the object is delivered and confirmed, so the object is delivered
once in any case. The third entries stay until it has been delivered: a boot epoch that finds both
delivers it and flags it `again`, since the node may have died right after the first delivery.
"""

from collections.abc import Iterator, Mapping

import msgspec

from zacoustic.core.base.moments import Moment
from zacoustic.core.streams.keys import Instance

_OUT = "object/out/"
_IN = "object/in/"
_AGE = "object/age/"
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
    """Its lineage in the count of its key."""
    number: int
    stream_digest: bytes
    """The stream's digest when it was published."""
    has_age: bool = False
    """Whether it says how old it is."""
    made: Moment | None = None
    """When it was made, if that is to be said and known."""


class StoredAge(msgspec.Struct, frozen=True, array_like=True):
    """The age of an incoming object."""

    age_s: float | None
    """As its first fragment had arrived, s; None: unknown."""
    error_s: float | None
    """How wrong that may be, s; None: nothing bounds it."""
    received: Moment | None
    """When that was."""


class StoredProgress(msgspec.Struct, frozen=True, array_like=True):
    """The fragment from which on none has been sent."""

    next_source: int
    next_seed: int


class StoredEnd(msgspec.Struct, frozen=True, array_like=True):
    """An object that was delivered."""

    digest: bytes
    head: tuple[bytes, ...]
    stream_digest: bytes = b""
    """The stream's digest at the end, while the fragments are kept for delivery."""


def out_key(transfer: int) -> str:
    """Return the key of an outgoing object."""
    return f"{_OUT}{transfer}"


def sent_key(transfer: int) -> str:
    """Return the key of an outgoing object's progress."""
    return f"{_OUT}{transfer}{_SENT}"


def group_key(source: int, transfer: int, group: int) -> str:
    """Return the key of a group of fragments."""
    return f"{_IN}{source}/{transfer}/{group}"


def age_key(source: int, transfer: int) -> str:
    """Return the key of the age of an incoming object."""
    return f"{_AGE}{source}/{transfer}"


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


def stored_ages(stored: Mapping[str, bytes]) -> Iterator[tuple[int, int, StoredAge]]:
    """Yield ``(source, transfer, age)`` of the incoming objects that said it."""
    for key, value in stored.items():
        if key.startswith(_AGE):
            source, transfer = map(int, key.removeprefix(_AGE).split("/"))
            yield source, transfer, msgspec.msgpack.decode(value, type=StoredAge)


def stored_ends(stored: Mapping[str, bytes]) -> Iterator[tuple[int, int, StoredEnd]]:
    """Yield ``(source, transfer, end)`` of the objects that were delivered."""
    for key, value in stored.items():
        if key.startswith(_DONE):
            source, transfer = map(int, key.removeprefix(_DONE).split("/"))
            yield source, transfer, msgspec.msgpack.decode(value, type=StoredEnd)
