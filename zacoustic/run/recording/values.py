"""Values of topics in a recording: JSON by their type, or CDR for streams of ROS."""

from collections.abc import Mapping
from typing import Any, Final

from zacoustic.core.base.qos import Stamp
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import PayloadInvalidError, ZacousticError
from zacoustic.ros.streams import RosStream, RosTopic
from zacoustic.run.recording.calls import plain
from zacoustic.run.recording.channels import CDR, ROS_SCHEMA, Channel, value_channel
from zacoustic.run.recording.foxglove import FoxgloveWriter, made_at
from zacoustic.run.recording.schemas import OpaqueValue, as_json
from zacoustic.run.recording.writing import MessageSink

_MOST_CHANNELS: Final = 4096


def key_of(stream: Stream, source: int, instance: Instance) -> str:
    """Return the key of a sample, or the name of its stream if it has no key."""
    try:
        return stream.keys.key(source, instance)
    except ZacousticError:
        return stream.name


class ValueWriter:
    """Writes the values of one node.

    Args:
        sink: Takes the messages.
        node: Address of the node.
        table: Its streams.
        ros: The ROS types of streams by id.
    """

    def __init__(
        self, sink: MessageSink, node: int, table: StreamTable, ros: Mapping[int, RosStream]
    ) -> None:
        self._sink = sink
        self._node = node
        self._table = table
        self._ros = ros
        self._channels: dict[str, Channel] = {}
        self.panels = FoxgloveWriter(sink.put)
        """Writes what Foxglove's panels show."""

    def received(self, event: SampleReceived, utc_ns: int) -> None:
        """Write a received sample."""
        stream = self._table.by_id(event.stream_id)
        key = key_of(stream, event.source, event.instance)
        is_unknown = event.age_s is None and stream.qos.stamp is Stamp.AGE
        self._write(
            "received", stream, key, event.value, event.encoding, utc_ns,
            node=event.source, made_ns=None if is_unknown else made_at(utc_ns, event.age_s),
        )  # fmt: skip

    def published(self, arguments: Mapping[str, Any], utc_ns: int, now: int) -> None:
        """Write a published sample.

        Args:
            arguments: Those of `Engine.publish`.
            utc_ns: The instant in UTC, ns since 1970.
            now: The same instant by the engine's clock, ns.
        """
        stream = self._table.by_id(arguments["stream_id"])
        key = key_of(stream, self._node, arguments.get("instance", ()))
        encoding = arguments.get("encoding") or stream.encoding
        value = arguments.get("value")
        if stream.type is not None:
            value = stream.type.validate(value)
        queued_at = arguments.get("queued_at")
        made_ns = utc_ns if queued_at is None else utc_ns - max(0, now - queued_at)
        self._write(
            "published", stream, key, value, encoding, utc_ns, node=self._node,
            made_ns=made_ns if arguments.get("is_dated", True) else None,
        )  # fmt: skip

    def _write(
        self, word: str, stream: Stream, key: str, value: object, encoding: str, utc_ns: int,
        *, node: int, made_ns: int | None,
    ) -> None:  # fmt: skip
        """Write a value; of unknown age it shows on no panel, and a ROS stamp stays zero."""
        topic = f"/{self._node}/{word}/{key}"
        ros = self._ros.get(stream.stream_id)
        if isinstance(ros, RosTopic):
            try:
                data = ros.message.write(value, made_ns)
            except PayloadInvalidError:
                return  # the gateway has reported the error
        else:
            ros = None
            data = encode_value(stream, value, encoding)
        channel = self._channels.get(topic)
        if channel is None:
            if len(self._channels) >= _MOST_CHANNELS:
                return
            made = ros_channel(topic, stream, ros) if ros else value_channel(topic, stream)
            channel = self._channels[topic] = made
        self._sink.put(channel, utc_ns, data)
        if ros is None and made_ns is not None:  # Foxglove knows those of ROS
            self.panels.value(topic, value, utc_ns, made_ns=made_ns, node=node, spec=stream.type)


def encode_value(stream: Stream, value: object, encoding: str = "") -> bytes:
    """Encode a value for `value_channel`."""
    if stream.type is not None:
        return as_json(plain(value))
    octets = bytes(value) if isinstance(value, bytes | bytearray | memoryview) else b""
    return as_json(OpaqueValue(data=octets, size_bytes=len(octets), encoding=encoding))


def ros_channel(topic: str, stream: Stream, ros: RosTopic) -> Channel:
    """Return the channel of the messages of a ROS topic, in CDR."""
    return Channel(
        topic=topic,
        encoding=CDR,
        schema_name=ros.interface,
        schema_encoding=ROS_SCHEMA,
        schema=ros.message.definition().encode(),
        metadata={"stream_id": str(stream.stream_id), "stream": stream.name},
    )
