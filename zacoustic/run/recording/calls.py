"""Calls of an engine as bytes and back, with outcomes that can be compared.

A call is an array: number of its name, arguments by parameter, result, exception. Calls between two
services of the engine share a message. Values of the application are stored as plain parts, which
`TypeSpec.validate` accepts. Of a write to the journal only a digest is stored, since a replay does
not need its content.
"""

import enum
import hashlib
import typing
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final

import msgspec

from zacoustic.core.base.journal import JournalWrite
from zacoustic.core.engine.tap import CALLS, EngineCall, method_of
from zacoustic.core.values.types import TypeSpec
from zacoustic.core.values.types.scalars import enum_name
from zacoustic.errors import ConfigError
from zacoustic.run.recording.life import exact_spec
from zacoustic.run.recording.version import of_another_version

TYPES: Final = "zacoustic_types"
"""Additional argument of a recorded `declare`: the types of the table."""

_LATER: Final = "then"
"""Argument that is a function of the application; a replay calls one that returns nothing."""
_EVENT: Final = "poll_event"
_NOTHING: Final = b"\xc0"
"""The outcome of a call that has returned None."""
_VALUES: Final = ("value",)
"""Arguments of any type, as the application passes them."""


class Recorded(msgspec.Struct, frozen=True):
    """A recorded call."""

    name: str
    """One of `CALLS`."""
    arguments: dict[str, Any]
    """By parameter, for `call_engine`."""
    outcome: bytes
    """Its outcome, as written by `outcome_of`."""

    @property
    def now(self) -> int | None:
        """Instant of the call, ns; None: it has none."""
        now = self.arguments.get("now")
        return now if isinstance(now, int) else None


def plain(value: object) -> object:
    """Return a value of the application in plain parts."""
    if isinstance(value, msgspec.Struct):
        return {name: plain(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, Mapping):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, enum.Enum):
        return enum_name(value)
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, bytearray | memoryview):
        return bytes(value)
    return value


def _foreign(value: object) -> object:
    """Convert what msgspec cannot write: numbers and arrays of numpy, sets."""
    convert = getattr(value, "tolist", None)
    if convert is not None:
        return convert()
    if isinstance(value, frozenset | set):
        return sorted(value)
    raise NotImplementedError(type(value).__name__)


_encoder: Final = msgspec.msgpack.Encoder(enc_hook=_foreign)
_UNREADABLE: Final = (TypeError, ValueError, OverflowError, NotImplementedError, RecursionError)


def outcome_of(result: object, error: Exception | None = None) -> bytes:
    """Write the outcome of a call so that two outcomes can be compared byte for byte.

    Args:
        result: The returned value.
        error: The exception raised instead.
    """
    if error is not None:
        return _encoder.encode(["raised", type(error).__name__])
    if result is None or isinstance(result, bool | int):
        return _encoder.encode(result)
    if isinstance(result, JournalWrite):
        content = None if result.value is None else hashlib.sha256(result.value).digest()[:8]
        return _encoder.encode(["JournalWrite", result.write_id, result.key, content])
    if isinstance(result, msgspec.Struct):
        return _encoder.encode([type(result).__name__, result])
    return _encoder.encode([type(result).__name__])  # a Stream, whose spec is an argument


def read_outcome(outcome: bytes) -> Any:  # noqa: ANN401 (as it was written)
    """Return the outcome of a call in plain parts; None: it cannot be read."""
    try:
        return msgspec.msgpack.decode(outcome)
    except (msgspec.DecodeError, RecursionError):
        return None


def encode_call(call: EngineCall, types: Sequence[TypeSpec] = ()) -> bytes:
    """Write a call.

    Args:
        call: The call.
        types: For a `declare`, the types of the table.
    """
    arguments = {name: each for name, each in call.arguments.items() if name != _LATER}
    for name in _VALUES:
        if name in arguments:
            arguments[name] = plain(arguments[name])
    if call.name == "declare":
        arguments[TYPES] = types
    outcome = msgspec.Raw(outcome_of(call.result, call.error))
    number = CALLS.index(call.name)
    try:
        return _encoder.encode([number, arguments, outcome])
    except _UNREADABLE as error:
        # The engine has refused such a value; a replay may pass anything that it refuses as well.
        said = {name: each for name, each in arguments.items() if name not in _VALUES}
        return _encoder.encode([number, {**said, "value": repr(error)}, outcome])


class CallReader:
    """Reads the calls of one boot epoch.

    Args:
        names: Names of the calls by number.
        only: The calls to read, and events that there were; None: all.
        program: Version of the program that recorded them.
        skips: Leave out calls that this program cannot read, in place of an error.
    """

    def __init__(
        self,
        names: Sequence[str],
        only: Collection[str] | None = None,
        *,
        program: str = "",
        skips: bool = False,
    ) -> None:
        self._names = names
        self._is_wanted = [only is None or name in only for name in names]
        self._events = names.index(_EVENT) if only is not None and _EVENT in names else None
        """Number of the call whose outcome alone is wanted, if it has one."""
        self._program = program
        self._skips = skips
        self.skipped = 0
        """How many calls were left out."""
        self._parameters: dict[str, dict[str, Any]] = {}
        self._decoder = msgspec.msgpack.Decoder(list[tuple[int, msgspec.Raw, msgspec.Raw]])
        self._arguments = msgspec.msgpack.Decoder(dict[str, Any])

    def read(self, data: bytes | msgspec.Raw) -> Iterator[Recorded]:
        """Read the calls of a message.

        Raises:
            ConfigError: It is damaged, or contains something unknown to this program.
        """
        try:
            for number, arguments, outcome in self._decoder.decode(data):
                if not self._is_wanted[number]:
                    continue
                name, told = self._names[number], bytes(outcome)
                if number == self._events:
                    if told != _NOTHING:
                        yield Recorded(name, {}, told)
                    continue
                try:
                    typed = self._typed(name, self._arguments.decode(arguments))
                except (msgspec.ValidationError, ConfigError):
                    if not self._skips:
                        raise
                    self.skipped += 1
                    continue
                yield Recorded(name, typed, told)
        except (msgspec.DecodeError, ValueError, IndexError, RecursionError, ConfigError) as error:
            raise of_another_version(
                self._program, f"a call of the engine cannot be read, {error}"
            ) from error

    def _typed(self, name: str, arguments: dict[str, Any]) -> dict[str, Any]:
        parameters = self._parameters.get(name)
        if parameters is None:
            parameters = self._parameters[name] = _parameters(name)
        found: dict[str, Any] = {}
        for each, written in arguments.items():
            expected = parameters.get(each, Any)
            if each in _VALUES or expected is Any:
                found[each] = written
            else:
                found[each] = msgspec.convert(written, _kind(expected, written))
            if name == "declare" and each == "spec":
                found[each] = exact_spec(found[each], written)
        if _LATER in parameters and name in ("commands.execute", "routing.execute"):
            found[_LATER] = _heed
        return found


def _parameters(name: str) -> dict[str, Any]:
    """Return the types of the parameters of a call."""
    if name not in CALLS:
        raise ConfigError(f'the engine of this program has no "{name}"')
    hints = typing.get_type_hints(method_of(name))
    hints.pop("return", None)
    if name == "declare":
        hints[TYPES] = tuple[TypeSpec, ...]
    return hints


def _kind(expected: Any, written: object) -> Any:  # noqa: ANN401 (types of any kind)
    """Return the type to read a parameter as: among records without a tag, the one that fits."""
    kinds = [
        kind
        for kind in typing.get_args(expected)
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    ]
    if len(kinds) < 2 or not isinstance(written, dict):
        return expected
    is_tagged = kinds[0].__struct_config__.tag is not None
    named = (kind for kind in kinds if written.keys() <= {*kind.__struct_fields__})
    return expected if is_tagged else next(named, kinds[0])


def _heed(*state: object) -> None:
    """Ignore the state of a journalled command: the application has it."""
