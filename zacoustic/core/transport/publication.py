"""`Publication`: a sample from the application to the engine, and its encoded form."""

from typing import Any

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.moments import Made
from zacoustic.core.base.qos import Stamp
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream
from zacoustic.core.values.encoding import encode_prefix
from zacoustic.core.wire.frame import Control


class Publication(msgspec.Struct, frozen=True):
    """The argument of `Engine.publish`."""

    stream_id: int
    """The topic's stream."""
    value: object
    """The value in the stream's type; bytes for an opaque stream; ignored for a delete."""
    instance: Instance = ()
    """One value number for each wildcard of the topic's name."""
    encoding: str | None = None
    """The Zenoh encoding, where it is not the stream's."""
    delete: bool = False
    """Delete the key instead."""
    queued_at: int | None = None
    """Instant at which the sample was made, ns, if that was before the call."""
    is_dated: bool = True
    """Whether it is known when the sample was made; otherwise its age crosses as unknown."""

    def made_at(self, now: int) -> int:
        """Return the instant at which the sample was made."""
        return now if self.queued_at is None else min(self.queued_at, now)

    def expires_at(self, stream: Stream, now: int) -> int | None:
        """Return the instant from which it is worthless, ns; None: never."""
        lifespan_s = stream.qos.lifespan_s
        return None if lifespan_s is None else self.made_at(now) + seconds_to_ns(lifespan_s)


class EncodedSample(msgspec.Struct, frozen=True, kw_only=True):
    """A sample encoded for its record."""

    instance: Instance
    """Value numbers of the wildcards, as published."""
    prefix: bytes
    """Controls before it: DELETE, or ENCODING."""
    payload: bytes
    """The encoded value."""
    dense_value: dict[str, Any] | None
    """The value for a dense block; None: this sample does not go into one."""
    stamped: bool
    """Whether its record carries its age."""
    encoding: str | None
    """Its encoding, where it is not the stream's."""
    made_at: int
    """Instant at which it was made, or else queued, ns."""
    dated_at: Made
    """When it was made, as far as known."""
    expires_at: int | None
    """Instant from which it is worthless, ns; None: never."""

    @property
    def record_bytes(self) -> int:
        """Length of its best-effort record, bytes."""
        return len(self.prefix) + 1 + len(self.instance) + self.stamped + len(self.payload)


def encode_sample(stream: Stream, publication: Publication, now: int) -> EncodedSample:
    """Encode a sample.

    Raises:
        PayloadInvalidError: The type does not allow the value.
    """
    delete, encoding = publication.delete, None
    prefix = bytes((Control.DELETE,)) if delete else b""
    if publication.encoding not in (None, stream.encoding) and not delete:
        encoding = publication.encoding
        prefix = bytes((Control.ENCODING,)) + encode_prefix(encoding)
    dense_value, payload = None, b""
    if stream.dense_type is not None and not prefix:
        dense_value, payload = stream.dense_value(publication.value)
    elif not delete:
        payload = stream.codec.encode(publication.value)
    return EncodedSample(
        instance=publication.instance,
        prefix=prefix,
        payload=payload,
        dense_value=dense_value,
        stamped=stream.qos.stamp is Stamp.AGE and not delete,
        encoding=encoding,
        made_at=publication.made_at(now),
        dated_at=publication.made_at(now) if publication.is_dated else None,
        expires_at=publication.expires_at(stream, now),
    )
