"""A boot epoch of a node: all parameters of its engine, so that it can be made again.

The configuration is not kept as it was written: it names files, Python modules and ROS packages
that another computer does not have. What is kept is what came of it, the table and the rules.
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

FORMAT: Final = 1
"""Changes when an older program could not read the calls."""


class Randomness(msgspec.Struct, frozen=True, kw_only=True):
    """State of a `random.Random`."""

    version: int
    """Of the state."""
    words: bytes
    """Each four bytes, little-endian."""
    gauss: float | None = None
    """The other half of the last pair of Gaussian numbers."""

    @classmethod
    def of(cls, rng: random.Random) -> "Randomness":
        """Return the state of a generator."""
        version, words, gauss = rng.getstate()
        return cls(version=version, words=struct.pack(f"<{len(words)}I", *words), gauss=gauss)

    def generator(self) -> random.Random:
        """Return a generator in this state.

        Raises:
            ConfigError: It is none.
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
    """What is spoken."""

    @classmethod
    def of(cls, table: StreamTable) -> "Table":
        """Return what a table is made of."""
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
            ConfigError: This program does not allow something of it.
        """
        return StreamTable(
            self.streams,
            types=TypeTable(self.types),
            nodes=self.nodes,
            model=self.model,
            wire=self.wire,
        )


class Life(msgspec.Struct, frozen=True, kw_only=True):
    """What an engine was made of."""

    format: int = FORMAT
    """See `FORMAT`."""
    program: str = ""
    """Version of the program that has recorded it."""
    calls: tuple[str, ...] = CALLS
    """Names of the calls, by their numbers in what follows."""
    address: int
    """Of the node."""
    epoch: int
    """Its boot epoch."""
    utc_offset_ns: int
    """UTC less the engine's clock, at the start of this boot epoch, ns: what instants of the file
    are made of."""
    randomness: Randomness
    """Before the engine was made."""
    stored: dict[str, bytes]
    """The journal's entries of former boot epochs."""
    rules: TransmitRules
    """When, and how much, the node may transmit."""
    table: Table
    """Its streams."""
    digest: bytes
    """Of the table."""
    is_sealed: bool = False
    """Its frames were sealed: to make it again takes the key, which is not kept here."""

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
            cipher: Has the keys of the fleet, where frames were sealed.

        Raises:
            ConfigError: It cannot be made by this program, or without a key.
        """
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
            rules=self.rules if rules is None else rules,
            stored=self.stored,
            trace=trace,
            cipher=cipher if self.is_sealed else None,
        )


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
    """Write down the parameters of a new engine."""
    life = Life(
        program=program,
        address=address,
        epoch=epoch,
        utc_offset_ns=utc_offset_ns,
        randomness=Randomness.of(rng),
        stored=dict(stored),
        rules=rules,
        table=Table.of(table),
        digest=table.digest,
        is_sealed=is_sealed,
    )
    return msgspec.msgpack.encode(life)


def decode_life(data: bytes) -> Life:
    """Read what an engine was made of.

    Raises:
        ConfigError: It was written by another program, or is damaged.
    """
    try:
        life = msgspec.msgpack.decode(data, type=Life)
        streams = msgspec.msgpack.decode(data)["table"]["streams"]
    except (msgspec.DecodeError, RecursionError) as error:
        raise ConfigError(
            f"the recording of a life cannot be read: {error}", hint="replay it as it was recorded"
        ) from error
    pairs = zip(life.table.streams, streams, strict=True)
    exact = tuple(exact_spec(spec, written) for spec, written in pairs)
    table = msgspec.structs.replace(life.table, streams=exact)
    return msgspec.structs.replace(life, table=table)


def exact_spec(spec: StreamSpec, written: Mapping[str, object]) -> StreamSpec:
    """Return a spec with the numbers as they were written: of 60 and 60.0 digests differ.

    Args:
        spec: As msgspec reads it, with floats.
        written: What it was read from.
    """
    integers = {
        name: value
        for name, value in written.items()
        if isinstance(value, int) and isinstance(getattr(spec, name, None), float)
    }
    return msgspec.structs.replace(spec, **integers)
