"""The samples of a recording, for a Zenoh network.

A recording of a network has the samples unchanged. A recording of an engine has values: they are
encoded in the encoding of their stream. Samples from the channel get the mark of a gateway again,
so that no gateway there transmits them.
"""

import binascii
from collections.abc import Iterator
from typing import Any

import msgspec

from zacoustic.config import Config
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.encoding import JSON, decode_application
from zacoustic.errors import ConfigError, PayloadInvalidError
from zacoustic.ros.attachment import Attachment
from zacoustic.ros.streams import RosTopic
from zacoustic.run.recording.epochs import LifeReader
from zacoustic.run.recording.reading import ReadMessage
from zacoustic.run.recording.samples import SAMPLES_TOPIC, SampleRecord
from zacoustic.run.recording.schemas import OpaqueValue
from zacoustic.text.digits import whole_number
from zacoustic.zenoh.session.marker import Marker
from zacoustic.zenoh.session.values import write_value

CDR = "application/cdr"
_GID = b"zacoustic replay"


class Put(msgspec.Struct, frozen=True, kw_only=True):
    """A sample to put, or a key to delete."""

    utc_ns: int
    """Time of its recording, ns since 1970."""
    key: str
    """Its key."""
    payload: bytes = b""
    """Its payload."""
    encoding: str = ""
    """Zenoh encoding."""
    attachment: bytes | None = None
    """Its attachment."""
    deleted: bool = False
    """Delete the key."""


class _Arrived(msgspec.Struct):
    """The required part of a sample's event."""

    event: str
    key: str = ""
    source: int = 0
    age_s: float | None = None
    encoding: str = ""
    deleted: bool = False


class PutReader:
    """Finds the samples.

    Args:
        node: Node of the samples; None: the only one.
        config: Names the keys of topics of ROS; None: recordings of engines lack those samples.
    """

    def __init__(self, *, node: int | None = None, config: Config | None = None) -> None:
        self._node = node
        self._is_chosen = node is not None
        self._ros = None if config is None else config.ros
        self._epochs = LifeReader()
        self._table: StreamTable | None = None
        self._arrived: _Arrived | None = None
        self._sequence = 0
        self.left_out: dict[str, int] = {}
        """Samples that cannot be put, by key."""

    def read(self, message: ReadMessage) -> Iterator[Put]:
        """Return the sample of a message.

        Raises:
            ConfigError: There are several nodes, and none is selected.
        """
        if message.topic == SAMPLES_TOPIC:
            record = msgspec.json.decode(message.data, type=SampleRecord)
            yield Put(
                utc_ns=message.utc_ns,
                key=record.key,
                payload=record.payload,
                encoding=record.encoding,
                attachment=record.attachment,
                deleted=record.deleted,
            )
            return
        node, _, rest = message.topic[1:].partition("/")
        word, _, key = rest.partition("/")
        address = whole_number(node)
        if address is None or not self._is_ours(address):
            return
        if word == "engine":
            life = self._epochs.life_in(message)
            if life is not None:
                self._table = life.table.table()
        elif word == "events":
            yield from self._note(message)
        elif word in ("published", "received") and self._table is not None:
            yield from self._value(message, word, key, self._table)

    def _is_ours(self, node: int) -> bool:
        if self._node is None:
            self._node = node
        elif self._node != node and not self._is_chosen:
            raise ConfigError(
                f"the recording is of several nodes, {self._node} and {node} among them",
                hint="say which: --node N",
            )
        return self._node == node

    def _note(self, message: ReadMessage) -> Iterator[Put]:
        """Store the facts about a sample, which accompany its value."""
        arrived = msgspec.json.decode(message.data, type=_Arrived)
        if arrived.event == "SampleReceived":
            self._arrived = arrived
            if arrived.deleted:
                mark = Marker(acoustic=arrived.source).encode()
                yield Put(utc_ns=message.utc_ns, key=arrived.key, attachment=mark, deleted=True)

    def _value(
        self, message: ReadMessage, word: str, key: str, table: StreamTable
    ) -> Iterator[Put]:
        stream = table.get(whole_number(message.metadata.get("stream_id", "")) or 0)
        arrived = self._arrived if word == "received" else None
        if stream is None:
            return
        if message.encoding == "cdr":
            yield from self._ros_value(message, stream, key)
            return
        encoding = stream.encoding
        if arrived is not None and arrived.key == key and arrived.encoding:
            encoding = arrived.encoding
        try:
            value, said = _value_of(stream, message.data)
            payload = write_value(value, stream.type, said or encoding)
        except PayloadInvalidError:
            self._leave_out(key)
            return
        attachment = None
        if arrived is not None and arrived.key == key:
            attachment = Marker(acoustic=arrived.source, age_s=arrived.age_s).encode()
        yield Put(
            utc_ns=message.utc_ns,
            key=key,
            payload=payload,
            encoding=said or encoding,
            attachment=attachment,
        )

    def _ros_value(self, message: ReadMessage, stream: Stream, key: str) -> Iterator[Put]:
        ros = None if self._ros is None else self._ros.streams.get(stream.stream_id)
        if self._ros is None or not isinstance(ros, RosTopic):
            self._leave_out(key)
            return
        self._sequence += 1
        beside = Attachment(sequence=self._sequence, stamp_ns=message.utc_ns, gid=_GID)
        yield Put(
            utc_ns=message.utc_ns,
            key=str(ros.key(self._ros.domain, key)),
            payload=message.data,
            encoding=CDR,
            attachment=beside.encode(),
        )

    def _leave_out(self, key: str) -> None:
        self.left_out[key] = self.left_out.get(key, 0) + 1


def _value_of(stream: Stream, data: bytes) -> tuple[object, str]:
    """Read a recorded value, with its encoding if that is recorded.

    Raises:
        PayloadInvalidError: It cannot be read.
    """
    if stream.type is not None:
        value: Any = decode_application(data, JSON, type_spec=stream.type)
        return value, ""
    try:
        opaque = msgspec.json.decode(data, type=OpaqueValue)
    except (msgspec.DecodeError, binascii.Error) as error:
        raise PayloadInvalidError(str(error)) from error
    return opaque.data, opaque.encoding
