"""Positions from another program, which moves nodes while a channel is simulated.

The program writes an object for each node that has moved, x east, y north, z down, in m::

    { "address": 2, "position": [1420.5, -3.0, 18.2] }

as lines of standard input (``--positions -``), or as samples on a key of Zenoh (``--positions
zenoh:KEY``; any key that the expression KEY matches). An invalid object is skipped and reported on
standard error, once until a valid one follows. Without new objects nodes stay where they are.

Threads read, so nothing waits and any operating system will do; the loop moves the nodes. Standard
input is read unbuffered: at its end the interpreter would wait for the lock of a buffered file.
"""

import argparse
import asyncio
import contextlib
import json
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any, Final, Protocol

import msgspec

from zacoustic.channel.propagation.position import Position
from zacoustic.errors import ConfigError, SessionError
from zacoustic.text.safetext import one_line, without_secrets

_PIECE_BYTES: Final = 4096
_LONGEST_LINE_BYTES: Final = 4096
_SHOWN_CHARACTERS: Final = 200
_INPUT: Final = "-"
_ZENOH: Final = "zenoh:"


class Source(Protocol):
    """Source of lines: a file without a buffer."""

    def read(self, size: int, /) -> bytes | None:
        """Return some bytes; none at the end of the file."""
        ...


class Move(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The new position of a node."""

    address: int
    """Its address in the scenario."""
    position: Position
    """x east, y north, z down, m."""


class Movable(Protocol):
    """A medium or a fleet of emulated modems, whose nodes can be moved."""

    def move(self, address: int, position: Position) -> None:
        """Set the position of a node from now on.

        Raises:
            ValueError: The node or the position is not valid.
        """
        ...


def add_positions(parser: argparse.ArgumentParser) -> None:
    """Declare the argument that names the source of positions."""
    parser.add_argument(
        "--positions", metavar="SOURCE",
        help="where nodes are, said by another program: - for lines of standard input, or "
        "zenoh:KEY; each {\"address\": 2, \"position\": [x, y, z]}",
    )  # fmt: skip
    parser.add_argument(
        "--connect", action="append", metavar="ENDPOINT",
        help="Zenoh endpoint for --positions, tcp/HOST:PORT (default: who is found)",
    )  # fmt: skip


@contextlib.contextmanager
def positions_from(arguments: argparse.Namespace, moved: Movable) -> Iterator[None]:
    """Move nodes on the running loop as another program says, by the arguments declared above.

    Raises:
        ConfigError: An argument is wrong.
        SessionError: Zenoh cannot be reached.
    """
    source: str | None = arguments.positions
    if arguments.connect and not (source or "").startswith(_ZENOH):
        raise ConfigError("--connect without --positions zenoh:KEY; allowed: both, or none of them")
    if source is None:
        yield
    elif source == _INPUT:
        follow_lines(unbuffered_input(), moved)
        yield
    elif source.startswith(_ZENOH):
        with _subscribed(source.removeprefix(_ZENOH), arguments.connect or [], taker_of(moved)):
            yield
    else:
        raise ConfigError(f"--positions {source}; allowed: -, or zenoh:KEY")


def taker_of(moved: Movable) -> Callable[[bytes], None]:
    """Return a function that takes one object on any thread and moves a node on the running loop.

    Raises:
        RuntimeError: Raised by the returned function: the loop has ended.
    """
    loop = asyncio.get_running_loop()
    is_told = False

    def move(text: bytes) -> None:
        nonlocal is_told
        try:
            said = msgspec.json.decode(text, type=Move)
            moved.move(said.address, said.position)
            is_told = False
        except (msgspec.DecodeError, ValueError) as error:
            if not is_told:
                shown = text.decode(errors="replace")[:_SHOWN_CHARACTERS]
                print(one_line(f"--positions: {error}: {shown!r}"), file=sys.stderr)
            is_told = True

    def take(text: bytes) -> None:
        loop.call_soon_threadsafe(move, text)

    return take


def unbuffered_input() -> Source:
    """Return standard input as a `Source`."""
    return open(sys.stdin.fileno(), "rb", 0, closefd=False)


def follow_lines(source: Source, moved: Movable) -> threading.Thread:
    """Move nodes by lines of input, on the running loop; return the thread that reads them."""
    take = taker_of(moved)

    def read() -> None:
        rest = b""
        while piece := source.read(_PIECE_BYTES):
            *lines, rest = (rest + piece).split(b"\n")
            rest = rest[-_LONGEST_LINE_BYTES:]
            for line in filter(bytes.strip, lines):
                try:
                    take(line)
                except RuntimeError:
                    return  # the loop has ended

    thread = threading.Thread(target=read, name="positions", daemon=True)
    thread.start()
    return thread


@contextlib.contextmanager
def _subscribed(key: str, endpoints: list[str], take: Callable[[bytes], None]) -> Iterator[None]:
    """Take the samples of a key.

    Raises:
        ConfigError: The key or an endpoint is not valid.
        SessionError: Zenoh cannot be reached.
    """
    import zenoh

    try:
        expression = zenoh.KeyExpr(key)
        config = zenoh.Config()
        if endpoints:
            config.insert_json5("mode", '"client"')
            config.insert_json5("connect/endpoints", json.dumps(endpoints))
    except zenoh.ZError as error:
        raise ConfigError(f"--positions {_ZENOH}{key}: {_first_line(error)}") from error

    def receive(sample: Any) -> None:  # noqa: ANN401 (of Zenoh)
        if sample.kind == zenoh.SampleKind.PUT:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                take(bytes(sample.payload))

    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        where = without_secrets(", ".join(endpoints)) or "Zenoh"
        raise SessionError(
            f"--positions: cannot join {where}: {_first_line(error)}",
            hint="is the router running, and is this its endpoint?",
        ) from error
    with session:
        session.declare_subscriber(expression, receive)
        yield


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]
