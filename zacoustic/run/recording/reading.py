"""Reads a recording from its beginning, even an unfinished or damaged one."""

import logging
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.run.recording.version import version_in
from zacoustic.text.digits import whole_number
from zacoustic.text.installing import with_extra

MAGIC: Final = b"\x89MCAP0\r\n"
"""The first bytes of an MCAP file."""
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
        from mcap.records import Channel, Header, Message
        from mcap.stream_reader import StreamReader

        channels: dict[int, Channel] = {}
        with self.path.open("rb") as file:
            reader = StreamReader(file, validate_crcs=True, record_size_limit=_LONGEST_BYTES)
            records = reader.records
            while True:
                try:
                    record = next(records, None)
                except Exception as error:  # any error of the library on a damaged file
                    self.damage = _damage(error)
                    if self._tells:
                        _logger.warning("%s ends early: %s", self.path, self.damage)
                    return
                if record is None:
                    return
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
