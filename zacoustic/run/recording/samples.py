"""Samples of a Zenoh network in a recording, byte for byte, so that they can be put again."""

from typing import Final

import msgspec

from zacoustic.core.streams.table import StreamTable
from zacoustic.run.recording.channels import JSON, JSON_SCHEMA, MSGPACK, Channel
from zacoustic.run.recording.life import Table
from zacoustic.run.recording.schemas import schema_of_struct

SAMPLES_TOPIC: Final = "/samples"
TABLE_TOPIC: Final = "/table"


class SampleRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A sample."""

    key: str
    """Its key."""
    payload: bytes
    """Its payload; empty for a deletion."""
    encoding: str = ""
    """Zenoh encoding."""
    attachment: bytes | None = None
    """Its attachment."""
    deleted: bool = False
    """The key was deleted."""
    source: int | None = None
    """For samples from the channel: address of the publisher."""
    age_s: float | None = None
    """For samples from the channel: age when it was put, s; None: unknown, or no stamp."""


def samples_channel() -> Channel:
    """Return the channel of `SampleRecord`s."""
    return Channel(
        topic=SAMPLES_TOPIC,
        encoding=JSON,
        schema_name="zacoustic.SampleRecord",
        schema_encoding=JSON_SCHEMA,
        schema=schema_of_struct(SampleRecord),
    )


def table_channel() -> Channel:
    """Return the channel of the stream table, for files without boot epochs."""
    return Channel(topic=TABLE_TOPIC, encoding=MSGPACK)


def encode_table(table: Table) -> bytes:
    """Write a table for `table_channel`."""
    return msgspec.msgpack.encode({"table": table})


def decode_table(data: bytes) -> StreamTable:
    """Read what `encode_table` has written.

    Raises:
        DecodeError: It is none.
        ConfigError: The table is not valid.
    """
    return msgspec.msgpack.decode(data, type=_TableMessage).table.table()


class _TableMessage(msgspec.Struct):
    table: Table
