"""Who steers the modems: a program that writes, line by line, where they are.

A thread reads, so that nothing waits and any operating system will do; the loop moves. It reads
without a buffer: an interpreter that ends would wait for the lock of one. What is no such line is
reported on standard error and skipped. When the input ends the modems stay where they are.
"""

import asyncio
import sys
import threading
from typing import Final, Protocol

import msgspec

from zacoustic.channel.propagation.position import Position

_PIECE_BYTES: Final = 4096
_LONGEST_LINE_BYTES: Final = 4096


class Source(Protocol):
    """Where lines come from: a file without a buffer."""

    def read(self, size: int, /) -> bytes | None:
        """Return some bytes; none at the end."""
        ...


class Move(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a modem is from now on."""

    address: int
    """Its place in the scenario."""
    position: Position
    """x east, y north, z down, m."""


class Movable(Protocol):
    """What has modems that can be moved: a `RunningFleet`."""

    def move(self, address: int, position: Position) -> None:
        """Tell where one is from now on."""
        ...


def unbuffered_input() -> Source:
    """Return standard input as a `Source`."""
    return open(sys.stdin.fileno(), "rb", 0, closefd=False)


def follow_moves(source: Source, running: Movable) -> threading.Thread:
    """Move modems by lines of input, on the running loop; return the thread that reads them."""
    loop = asyncio.get_running_loop()

    def move(line: bytes) -> None:
        try:
            said = msgspec.json.decode(line, type=Move)
            running.move(said.address, said.position)
        except (msgspec.DecodeError, ValueError) as error:
            print(f"--moves: {error}: {line.decode(errors='replace')!r}", file=sys.stderr)

    def read() -> None:
        rest = b""
        while piece := source.read(_PIECE_BYTES):
            *lines, rest = (rest + piece).split(b"\n")
            rest = rest[-_LONGEST_LINE_BYTES:]
            for line in filter(bytes.strip, lines):
                try:
                    loop.call_soon_threadsafe(move, line)
                except RuntimeError:
                    return  # the loop has ended

    thread = threading.Thread(target=read, name="moves", daemon=True)
    thread.start()
    return thread
