"""The boot epochs of nodes in a recording, one message after the other."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.tap import call_engine
from zacoustic.core.values.types import TypeTable
from zacoustic.errors import ConfigError, ZacousticError
from zacoustic.run.recording.calls import TYPES, CallReader, Recorded, outcome_of
from zacoustic.run.recording.life import FORMAT, Life, decode_life
from zacoustic.run.recording.reading import ReadMessage, RecordingReader
from zacoustic.run.recording.version import of_another_version
from zacoustic.text.digits import whole_number

_RECORD_HINT: Final = "record with --record at the gateway, the Node or zacoustic sim"


class NewLife(msgspec.Struct, frozen=True):
    """A node has begun a boot epoch."""

    life: Life
    """The parameters of its engine."""


class Calls(msgspec.Struct, frozen=True):
    """Calls of a node's present boot epoch."""

    node: int
    """Address of the node."""
    calls: tuple[Recorded, ...]
    """The calls in order."""


Part = NewLife | Calls


_NONE: Final = msgspec.Raw()


class _Written(msgspec.Struct):
    """A message of the channel of an engine."""

    life: msgspec.Raw = _NONE
    calls: msgspec.Raw = _NONE


class LifeReader:
    """Finds boot epochs and calls in the messages of a recording.

    Args:
        only: The calls to read; None: all.
        skips: Leave out calls that this program cannot read, in place of an error: for readers that
            make no engine.
    """

    def __init__(self, only: Collection[str] | None = None, *, skips: bool = False) -> None:
        self._only = only
        self.epochs = 0
        """Number of epochs begun."""
        self._skips = skips
        self._skipped = 0
        self._readers: dict[int, CallReader] = {}
        self._nodes: dict[str, int] = {}
        """By topic."""
        self._decoder = msgspec.msgpack.Decoder(_Written)

    @property
    def skipped(self) -> int:
        """How many calls were left out."""
        return self._skipped + sum(each.skipped for each in self._readers.values())

    def life_in(self, message: ReadMessage) -> Life | None:
        """Return the boot epoch that a message begins; None: it begins none. Errors as `read`."""
        part = self.read(message) if b"life" in message.data[:8] else None
        return part.life if isinstance(part, NewLife) else None

    def read(self, message: ReadMessage) -> Part | None:
        """Return the boot epoch or the calls of a message; None: it has none.

        Raises:
            ConfigError: An unknown version of the program recorded it.
        """
        if not message.topic.endswith("/engine") or message.encoding != "msgpack":
            return None
        try:
            written = self._decoder.decode(message.data)
        except msgspec.DecodeError as error:
            raise ConfigError(f"{message.topic}: {error}") from error
        if written.life is not _NONE:
            life = decode_life(bytes(written.life))
            if life.format != FORMAT:
                raise of_another_version(
                    life.program, f"{message.topic} has format {life.format}; allowed: {FORMAT}"
                )
            self.epochs += 1
            if (former := self._readers.get(life.address)) is not None:
                self._skipped += former.skipped
            self._readers[life.address] = CallReader(
                life.calls, self._only, program=life.program, skips=self._skips
            )
            return NewLife(life)
        node = self._nodes.get(message.topic)
        if node is None:
            node = whole_number(message.metadata.get("node", ""))
            if node is not None:
                self._nodes[message.topic] = node
        reader = self._readers.get(node) if node is not None else None
        if reader is None or node is None:
            return None  # of a boot epoch whose beginning is not in the file
        return Calls(node, tuple(reader.read(written.calls)))


def read_parts(path: str | Path, *, tells: bool = True) -> Iterator[Part]:
    """Read boot epochs and calls of a recording.

    Args:
        path: The file.
        tells: Log an early end.

    Raises:
        ConfigError: The file is not ours, or contains no boot epoch.
    """
    reader = LifeReader()
    for message in RecordingReader(path, tells=tells):
        part = reader.read(message)
        if part is not None:
            yield part
    must_have_epochs(reader, str(path))


def must_have_epochs(reader: LifeReader, name: str) -> None:
    """Check that a recording has a boot epoch.

    Raises:
        ConfigError: There is none.
    """
    if not reader.epochs:
        raise no_engine(name)


def no_engine(name: str) -> ConfigError:
    """Return the error for a recording without an engine."""
    return ConfigError(f"{name}: no engine was recorded in it", hint=_RECORD_HINT)


def nodes_of(path: str | Path) -> list[int]:
    """Return the addresses of the nodes whose engines are in a recording.

    Raises:
        ConfigError: The file is not ours, or contains no boot epoch.
    """
    # The caller reads the file again, for the contents of these boot epochs.
    parts = read_parts(path, tells=False)
    return sorted({part.life.address for part in parts if isinstance(part, NewLife)})


class Done(msgspec.Struct, frozen=True):
    """A repeated call."""

    result: Any
    """Its result; None if it raised."""
    outcome: bytes
    """Its outcome, in the form of recordings."""
    fault: Exception | None = None
    """An exception that an engine must not raise."""


def make_call(engine: Engine, call: Recorded) -> Done:
    """Repeat a recorded call on an engine."""
    arguments = call.arguments
    if call.name == "declare":
        arguments = dict(arguments)
        types = arguments.pop(TYPES, None)
        if types:
            engine.table.types = TypeTable(types)
    try:
        result = call_engine(engine, call.name, arguments)
    except (ZacousticError, ValueError) as error:
        return Done(None, outcome_of(None, error))
    except Exception as error:  # any error is the result
        return Done(None, outcome_of(None, error), error)
    return Done(result, outcome_of(result))
