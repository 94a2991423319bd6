"""The file of a recording, and the thread that writes it.

The loop of a node must not wait for a disk. So messages go into a queue of limited size, and a
thread compresses and writes them. If the queue is full, messages are dropped and counted. If the
disk is full or almost full, the recording ends with one report, and nothing else does: the last
space belongs to the journal.

The file consists of chunks that are each valid alone, and a chunk is finished at least every five
seconds. If the process dies, only that much is lost.
"""

import contextlib
import logging
import os
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, Protocol

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.run.privatefile import create_private
from zacoustic.run.recording.channels import Channel
from zacoustic.run.recording.version import library
from zacoustic.text.installing import with_extra

if TYPE_CHECKING:
    from mcap.writer import Writer

QUEUE_BYTES: Final = 16 << 20
"""Limit of waiting messages, bytes: hours of a modem's traffic."""
CHUNK_BYTES: Final = 1 << 20
"""Size at which a chunk is finished, bytes; suits Foxglove."""
FLUSH_S: Final = 5.0
"""Time after which a chunk is finished, s: the most that a crash loses."""
RESERVE_BYTES: Final = 64 << 20
"""Space that a recording leaves free on the disk, bytes, for the journal."""

_EXTRA: Final = with_extra("recording")
_logger = logging.getLogger(__name__)


class Message(msgspec.Struct, frozen=True):
    """A message for the file."""

    channel: Channel
    """Its channel."""
    utc_ns: int
    """When, ns since 1970, ≥ 0."""
    data: bytes
    """Its contents."""


class MessageSink(Protocol):
    """Takes messages."""

    def put(self, channel: Channel, utc_ns: int, data: bytes) -> bool:
        """Record a message; False: it was dropped."""
        ...


class RecordingFile:
    """An MCAP file being written; used by one thread at a time.

    Args:
        path: The file. An existing one stays untouched: the new one gets the time in its name.
        waits: `put` waits for the disk and drops nothing: for simulations.
        trouble: Called once when the recording ends early or a message was dropped, with the
            reason; from the writer's thread or from the caller of `put`.

    Raises:
        ConfigError: The file cannot be made, or the extra is missing.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        waits: bool = False,
        trouble: Callable[[str], None] | None = None,
    ) -> None:
        self.path = _free_name(Path(path))
        self.written = 0
        """Number of messages in the file."""
        self.dropped = 0
        """Number of messages dropped because the queue was full or the recording had ended."""
        self.failure = ""
        """Why the recording has ended early; empty: it has not."""
        self._trouble = trouble or _warn
        self._waits = waits
        self._stream, self._writer = _open(self.path)
        self._channels: dict[str, int] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._queue: deque[Message] = deque()
        self._queued_bytes = 0
        self._is_closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    def put(self, channel: Channel, utc_ns: int, data: bytes) -> bool:
        """Record a message; False: it was dropped."""
        with self._changed:
            if self._waits:
                self._changed.wait_for(lambda: self._has_room(data) or bool(self.failure))
            if self.failure or self._is_closing or not self._has_room(data):
                self.dropped += 1
                is_first = self.dropped == 1 and not self.failure
            else:
                self._queue.append(Message(channel, max(0, utc_ns), data))
                self._queued_bytes += len(data)
                self._changed.notify_all()
                return True
        if is_first:
            self._trouble(f"{self.path}: the disk is too slow, something is not recorded")
        return False

    def close(self) -> None:
        """Write the waiting messages and finish the file; blocks as long as the disk does."""
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        self._thread.join()

    def _has_room(self, data: bytes) -> bool:
        return not self._queue or self._queued_bytes + len(data) <= QUEUE_BYTES

    # The thread

    def _run(self) -> None:
        try:
            while self._write_some():
                pass
            self._writer.finish()  # type: ignore[no-untyped-call]
        except OSError as error:
            self._fail(error.strerror or str(error))
        finally:
            with contextlib.suppress(OSError):
                self._stream.close()

    def _write_some(self) -> bool:
        """Write messages until the present chunk is due; return False at the end."""
        is_over = False
        ends_s = time.monotonic() + FLUSH_S
        while (left_s := ends_s - time.monotonic()) > 0 and not is_over:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._is_closing, left_s)
                taken = tuple(self._queue)
                is_over = self._is_closing and not taken
            for message in taken:
                self._write(message)
                with self._changed:
                    self._queue.popleft()
                    self._queued_bytes -= len(message.data)
                    self.written += 1
                    self._changed.notify_all()
        free_bytes = shutil.disk_usage(self.path.parent).free
        if free_bytes < RESERVE_BYTES:
            raise OSError(f"the disk is almost full, {free_bytes >> 20} MiB are free")
        self._writer.flush()  # type: ignore[no-untyped-call]
        os.fsync(self._stream.fileno())  # so that a power cut loses no more than a crash
        return not is_over

    def _write(self, message: Message) -> None:
        channel = message.channel
        number = self._channels.get(channel.topic)
        if number is None:
            number = self._channels[channel.topic] = self._writer.register_channel(
                topic=channel.topic,
                message_encoding=channel.encoding,
                schema_id=self._schema(channel),
                metadata=channel.metadata,
            )
        self._writer.add_message(
            channel_id=number,
            log_time=message.utc_ns,
            publish_time=message.utc_ns,
            data=message.data,
        )

    def _schema(self, channel: Channel) -> int:
        if not channel.schema_encoding:
            return 0
        key = (channel.schema_name, channel.schema)
        number = self._schemas.get(key)
        if number is None:
            number = self._schemas[key] = self._writer.register_schema(
                name=channel.schema_name, encoding=channel.schema_encoding, data=channel.schema
            )
        return number

    def _fail(self, reason: str) -> None:
        with self._changed:
            self.failure = reason
            self.dropped += len(self._queue)
            self._queue.clear()
            self._changed.notify_all()
        self._trouble(f"{self.path}: the recording ends here: {reason}")


def _open(path: Path) -> "tuple[IO[bytes], Writer]":
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise ConfigError(f"recordings need {error.name}", hint=_EXTRA) from error
    stream: IO[bytes] | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = create_private(path)
        writer = Writer(stream, chunk_size=CHUNK_BYTES)
        writer.start(profile="", library=library())
        stream.flush()
    except OSError as error:
        if stream is not None:
            stream.close()
        raise ConfigError(
            f"recording {path}: {error.strerror}", hint="name a file that can be written"
        ) from error
    return stream, writer


def _free_name(path: Path) -> Path:
    """Return the path, with the time added to its name if it exists.

    Raises:
        ConfigError: It is a folder.
    """
    if path.is_dir():
        raise ConfigError(f"recording {path} is a folder; allowed: a file in it")
    if not path.exists():
        return path
    now = f"{datetime.now(UTC):%Y%m%dT%H%M%S}Z"
    for number in range(1, 1000):
        suffix = f".{now}" if number == 1 else f".{now}.{number}"
        found = path.with_name(f"{path.stem}{suffix}{path.suffix}")
        if not found.exists():
            return found
    return path


def _warn(text: str) -> None:
    _logger.warning("%s", text)
