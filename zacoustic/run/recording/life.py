"""A boot epoch of a node: all parameters of its engine, so that a replay can make it again.

The configuration itself is not stored: it names files, Python modules and ROS packages that another
computer lacks. The file stores the result of reading it, the table and the rules.
"""

import random
import struct
from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.base.trace import TraceSink
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.tap import CALLS
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.dense.model.prior import Model
from zacoustic.core.values.types import TypeSpec, TypeTable
from zacoustic.core.wire.seal import Cipher
from zacoustic.errors import ConfigError
from zacoustic.run.recording.version import of_another_version

FORMAT: Final = 1
"""Changes when an older program could no longer read the calls."""


class Randomness(msgspec.Struct, frozen=True, kw_only=True):
    """State of a `random.Random`."""

    version: int
    """Version of the state."""
    words: bytes
    """Words of four bytes, little-endian."""
    gauss: float | None = None
    """The unused half of the last pair of Gaussian numbers."""

    @classmethod
    def of(cls, rng: random.Random) -> "Randomness":
        """Return the state of a generator."""
        version, words, gauss = rng.getstate()
        return cls(version=version, words=struct.pack(f"<{len(words)}I", *words), gauss=gauss)

    def generator(self) -> random.Random:
        """Return a generator in this state.

        Raises:
            ConfigError: The state is not valid.
        """
        words = struct.unpack(f"<{len(self.words) // 4}I", self.words[: len(self.words) // 4 * 4])
        rng = random.Random()
        try:
            rng.setstate((self.version, words, self.gauss))
        except (ValueError, TypeError) as error:
            raise ConfigError(f"state of the random numbers: {error}") from error
        return rng


class Table(msgspec.Struct, frozen=True, kw_only=True):
    """A stream table."""

    streams: tuple[StreamSpec, ...]
    """The specification of each stream."""
    types: tuple[TypeSpec, ...]
    """The types, resolved."""
    nodes: dict[int, str]
    """Name of each node by address."""
    model: Model | None
    """The fitted model of the dense streams."""
    wire: WireProfile
    """The wire profile."""

    @classmethod
    def of(cls, table: StreamTable) -> "Table":
        """Return the parts of a table."""
        return cls(
            streams=tuple(stream.spec for stream in table),
            types=tuple(table.types),
            nodes=dict(table.nodes),
            model=table.model,
            wire=table.wire,
        )

    def table(self) -> StreamTable:
        """Make the table.

        Raises:
            ConfigError: This program does not accept a part of it.
        """
        return StreamTable(
            self.streams,
            types=TypeTable(self.types),
            nodes=self.nodes,
            model=self.model,
            wire=self.wire,
        )


class Life(msgspec.Struct, frozen=True, kw_only=True):
    """The parameters of an engine."""

    format: int = FORMAT
    """See `FORMAT`."""
    program: str = ""
    """Version of the recording program."""
    calls: tuple[str, ...] = CALLS
    """Names of the calls; calls are recorded by their index in it."""
    address: int
    """Address of the node."""
    epoch: int
    """Its boot epoch."""
    utc_offset_ns: int
    """UTC less the engine's clock at the start of this boot epoch, ns; the timestamps of the file
    are instants plus this."""
    randomness: Randomness
    """State of the generator before the engine was made."""
    stored: dict[str, bytes]
    """The journal's entries of former boot epochs."""
    rules: msgspec.Raw
    """When and how much the node may transmit: `TransmitRules`. Only an engine needs them; their
    fields change between versions."""
    table: Table
    """Its streams."""
    digest: bytes
    """Digest of the table."""
    is_sealed: bool = False
    """Its frames were sealed: making the engine again needs the key, which is not stored here."""

    def engine(
        self,
        *,
        table: StreamTable | None = None,
        rules: TransmitRules | None = None,
        trace: TraceSink | None = None,
        cipher: Cipher | None = None,
    ) -> Engine:
        """Make the engine again.

        Args:
            table: Another table in place of its own.
            rules: Other rules.
            trace: Takes trace records.
            cipher: The keys of the fleet, for sealed frames.

        Raises:
            ConfigError: This program cannot make it, or the key is missing.
        """
        if rules is None:
            rules = self.transmit_rules()
        if self.is_sealed and cipher is None:
            raise ConfigError(
                f"the frames of node {self.address} were sealed: its engine needs the key",
                hint="zacoustic replay --check --config FILE, a configuration with `security`",
            )
        if table is None:
            table = self.table.table()
            if table.digest != self.digest:
                raise ConfigError(
                    f"the table of node {self.address} has the digest {table.digest.hex()} here, "
                    f"and had {self.digest.hex()}",
                    hint=f"replay it with zacoustic {self.program}",
                )
        return Engine(
            address=self.address,
            table=table,
            epoch=self.epoch,
            rng=self.randomness.generator(),
            rules=rules,
            stored=self.stored,
            trace=trace,
            cipher=cipher if self.is_sealed else None,
        )

    def transmit_rules(self) -> TransmitRules:
        """Return the rules.

        Raises:
            ConfigError: Another version of the program wrote them.
        """
        try:
            return msgspec.msgpack.decode(self.rules, type=TransmitRules)
        except (msgspec.DecodeError, RecursionError) as error:
            raise of_another_version(
                self.program, f"the engine of node {self.address} cannot be made, {error}"
            ) from error


def encode_life(
    *,
    address: int,
    table: StreamTable,
    epoch: int,
    rng: random.Random,
    rules: TransmitRules,
    stored: Mapping[str, bytes],
    utc_offset_ns: int,
    program: str,
    is_sealed: bool = False,
) -> bytes:
    """Write the parameters of a new engine."""
    life = Life(
        program=program,
        address=address,
        epoch=epoch,
        utc_offset_ns=utc_offset_ns,
        randomness=Randomness.of(rng),
        stored=dict(stored),
        rules=msgspec.Raw(msgspec.msgpack.encode(rules)),
        table=Table.of(table),
        digest=table.digest,
        is_sealed=is_sealed,
    )
    return msgspec.msgpack.encode(life)


def decode_life(data: bytes) -> Life:
    """Read the parameters of an engine.

    Raises:
        ConfigError: Another program wrote them, or they are damaged.
    """
    try:
        life = msgspec.msgpack.decode(data, type=Life)
        streams = msgspec.msgpack.decode(data)["table"]["streams"]
    except (msgspec.DecodeError, RecursionError) as error:
        raise of_another_version(
            _program_of(data), f"the parameters of an engine cannot be read, {error}"
        ) from error
    pairs = zip(life.table.streams, streams, strict=True)
    exact = tuple(exact_spec(spec, written) for spec, written in pairs)
    table = msgspec.structs.replace(life.table, streams=exact)
    return msgspec.structs.replace(life, table=table)


def _program_of(data: bytes) -> str:
    """Return the version in parameters that cannot be read otherwise; empty: unknown."""
    try:
        return str(msgspec.msgpack.decode(data)["program"])
    except (msgspec.DecodeError, RecursionError, KeyError, TypeError):
        return ""


def exact_spec(spec: StreamSpec, written: Mapping[str, object]) -> StreamSpec:
    """Return a spec with its numbers as written, because the digests of 60 and 60.0 differ.

    Args:
        spec: The spec as msgspec reads it, with floats.
        written: The object that it was read from.
    """
    integers = {
        name: value
        for name, value in written.items()
        if isinstance(value, int) and isinstance(getattr(spec, name, None), float)
    }
    return msgspec.structs.replace(spec, **integers)
