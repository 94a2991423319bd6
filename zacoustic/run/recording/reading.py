"""Reads a recording from its beginning, even an unfinished or damaged one."""

import logging
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.run.recording.version import version_in
from zacoustic.text.digits import whole_number
from zacoustic.text.installing import with_extra

MAGIC: Final = b"\x89MCAP0\r\n"
"""The first bytes of an MCAP file."""
if TYPE_CHECKING:
    from mcap.records import Channel, Chunk

_CHANNEL: Final = 4
"""Opcode of a channel in a chunk."""
_MESSAGE: Final = 5
"""Opcode of a message in a chunk."""
_MESSAGE_INDEX: Final = 7
"""Opcode of the index of a channel in a chunk."""
_HEAD: Final = struct.Struct("<BQ")
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_LONGEST_BYTES: Final = 64 << 20
_EXTRA: Final = with_extra("recording")

_logger = logging.getLogger(__name__)


class ReadMessage(msgspec.Struct, frozen=True):
    """A message of a recording."""

    topic: str
    """Topic of the channel."""
    utc_ns: int
    """When, ns since 1970."""
    encoding: str
    """Encoding of the message."""
    metadata: dict[str, str]
    """Metadata of the channel."""
    data: bytes
    """Its contents."""

    @property
    def name(self) -> str:
        """What it is: the last part of the topic."""
        return self.topic.rpartition("/")[2]

    @property
    def node(self) -> int | None:
        """The node before it in the topic, or None."""
        return whole_number(self.topic.rpartition("/")[0].rpartition("/")[2])

    @property
    def is_of_network(self) -> bool:
        """Whether a gateway has published it under this topic."""
        return self.topic.startswith("/@acoustic/")


class RecordingReader:
    """Reads the messages of a file, in the order of their writing.

    Args:
        path: The file.
        tells: Log an early end; not for callers that report it themselves.

    Raises:
        ConfigError: It cannot be opened, is not an MCAP file, or the extra is missing.
    """

    def __init__(self, path: str | Path, *, tells: bool = True) -> None:
        self.path = Path(path)
        self._tells = tells
        self.damage = ""
        """Why reading stopped early: the file is unfinished or damaged; empty: it is whole. Valid
        after reading."""
        self.share = 0.0
        """How much of the file has been read, 0…1."""
        self.program = ""
        """Version of the program that made the file; empty: another program, or not yet read."""
        try:
            with self.path.open("rb") as file:
                head = file.read(len(MAGIC))
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}") from error
        if head != MAGIC:
            raise ConfigError(
                f"{path}: no MCAP file", hint="zacoustic record, or --record, makes one"
            )
        try:
            import mcap.stream_reader  # noqa: F401 (tests that it is installed)
        except ImportError as error:
            raise ConfigError(f"recordings need {error.name}", hint=_EXTRA) from error

    def __iter__(self) -> Iterator[ReadMessage]:
        """Read all messages up to the first damage, which `damage` names."""
        from mcap.records import Channel, Chunk, Header, Message
        from mcap.stream_reader import StreamReader

        class WithoutIndex(StreamReader):
            """Skips the index behind each chunk, a sixth of the time: nobody seeks here."""

            def _read_record(self, opcode: int, length: int) -> Any:  # noqa: ANN401
                if opcode == _MESSAGE_INDEX:
                    self._stream.read(length)
                    return None
                return super()._read_record(opcode, length)

        channels: dict[int, Channel] = {}
        size_bytes = max(1, self.path.stat().st_size)
        with self.path.open("rb") as file:
            reader = WithoutIndex(
                file, emit_chunks=True, validate_crcs=True, record_size_limit=_LONGEST_BYTES
            )
            records = reader.records
            while True:
                inside: list[Channel | _Told] = []
                try:
                    record = next(records, None)
                    if isinstance(record, Chunk):
                        inside = _inside(record)
                except Exception as error:  # any error of the library on a damaged file
                    self.damage = _damage(error)
                    if self._tells:
                        _logger.warning("%s ends early: %s", self.path, self.damage)
                    return
                if record is None:
                    return
                self.share = min(1.0, file.tell() / size_bytes)
                for each in inside:
                    if isinstance(each, Channel):
                        channels[each.id] = each
                    elif (channel := channels.get(each[0])) is not None:
                        yield ReadMessage(
                            channel.topic,
                            each[1],
                            channel.message_encoding,
                            channel.metadata,
                            each[2],
                        )
                if isinstance(record, Header):
                    self.program = version_in(record.library)
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message) and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    yield ReadMessage(
                        channel.topic,
                        record.log_time,
                        channel.message_encoding,
                        channel.metadata,
                        record.data,
                    )


_Told = tuple[int, int, bytes]
"""Channel, instant, ns since 1970, and contents of a message."""


def _inside(chunk: "Chunk") -> "list[Channel | _Told]":
    """Return the channels and messages of a chunk.

    The library's own reader makes an object of each record, in five times the time.

    Raises:
        ValueError, EndOfFile, struct.error: It is damaged.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import EndOfFile
    from mcap.records import Channel
    from mcap.stream_reader import get_chunk_data_stream

    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    data, at = stream.read(size), 0
    found: list[Channel | _Told] = []
    while at < size:
        opcode, length = _HEAD.unpack_from(data, at)
        begin = at + _HEAD.size
        at = begin + length
        if at > size:
            raise EndOfFile
        if opcode == _MESSAGE:
            channel_id, _, log_time, _ = _MESSAGE_HEAD.unpack_from(data, begin)
            found.append((channel_id, log_time, data[begin + _MESSAGE_HEAD.size : at]))
        elif opcode == _CHANNEL:
            found.append(Channel.read(ReadDataStream(BytesIO(data[begin:at]))))
    return found


def _damage(error: Exception) -> str:
    """Return the fault of a file, from the library's error."""
    from mcap.exceptions import EndOfFile

    is_cut = isinstance(error, EndOfFile | struct.error)
    return "it is cut off" if is_cut else f"it is damaged, {' '.join(str(error).split())}"


def is_recording(path: str | Path) -> bool:
    """Tell whether a file is an MCAP file; False if it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False
