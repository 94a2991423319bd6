"""Lives of a sealed node that end by kill −9, and the log of every key and nonce it has used.

The process of this module makes the lives: it reads a `Life` from each line of its input, forks,
lets the child run a real node on a real disk for that long, kills it, and answers with an `Ended`::

    python -m tests.seal.lifetimes

The child writes each key and nonce into a pipe before the cipher gets them, so none can be used and
not be in the log. What it does is drawn from the seed of its life: it publishes, calls and commands
on two links, declares streams, which begins another life in the same process, and loses its engine
by a fault, which does as well. Its disk may be faulty: a write, its sync or a rename fails, before
or after it was done, or leaves half of a file.
"""

import asyncio
import contextlib
import hashlib
import logging
import os
import random
import select
import signal
import sqlite3
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NoReturn, Self
from unittest import mock

import msgspec
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ZacousticError
from zacoustic.link import Link, LinkConfig, LinkReceiver
from zacoustic.run.journal import journal_in
from zacoustic.run.journal.file import JournalFile
from zacoustic.run.node import LinkNode
from zacoustic.run.runner import LinkRunner
from zacoustic.seal import ccm
from zacoustic.seal.spec import SecuritySpec

ADDRESS: Final = 1
KEY_BYTES: Final = 8
NONCE_BYTES: Final = 13
PAIR_BYTES: Final = KEY_BYTES + NONCE_BYTES
NAV, LOG, ARM = 10, 11, 20
_DECLARED: Final = range(100, 150)
_RULES: Final = TransmitRules(
    links=(LinkRules(name="sound"), LinkRules(name="radio", port=1)),
    links_of_streams={LOG: "radio"},
)
_FAULTS: Final = 0.03
"""How many steps of a faulty disk fail."""


class Life(msgspec.Struct, frozen=True, kw_only=True):
    """One life, as it is ordered."""

    folder: str
    """Where key, lives and journal are."""
    seed: int
    lasts_s: float
    """How long, if it seals nothing."""
    after_s: float | None
    """How long after its first frame; None: that makes no difference."""
    is_faulty: bool
    """Its disk is."""


class Ended(msgspec.Struct, frozen=True, kw_only=True):
    """What has become of it."""

    pairs: bytes
    """Digest of the key and nonce, `PAIR_BYTES` each."""
    status: int
    """Of the process, as `os.waitpid` says."""


class Logged:
    """`AESCCM`, with a log of what encrypts."""

    def __init__(self, key: bytes, tag_length: int) -> None:
        self._key = hashlib.sha256(key).digest()[:KEY_BYTES]
        self._cipher = AESCCM(key, tag_length)

    def encrypt(self, nonce: bytes, data: bytes, associated_data: bytes | None) -> bytes:
        """Note the pair, then use it."""
        os.write(_log[0], self._key + nonce)
        return self._cipher.encrypt(nonce, data, associated_data)

    def decrypt(self, nonce: bytes, data: bytes, associated_data: bytes | None) -> bytes:
        """Open a frame."""
        return self._cipher.decrypt(nonce, data, associated_data)


_log = [-1]


class DeafLink(Link):
    """Comes up at once, transmits at once, and hears nobody."""

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        return cls()

    async def open(self, receiver: LinkReceiver) -> None:
        self._receiver = receiver
        self.capabilities = LinkCapabilities(mtu_bytes=64, bit_rate_bps=1e7, propagation_s=1e-4)
        receiver.state_changed(LinkState.UP, "deaf")

    async def close(self) -> None:
        """Nothing is held."""

    def transmit(self, transmission: Transmission) -> None:
        asyncio.get_running_loop().call_soon(self._finish, transmission.transmission_id)

    def _finish(self, transmission_id: int) -> None:
        now = time.monotonic_ns()
        self._receiver.transmit_finished(
            TransmitReport(
                transmission_id=transmission_id,
                outcome=TransmitOutcome.SENT,
                started_at=now,
                finished_at=now,
            )
        )


def spoil_disk(rng: random.Random) -> None:
    """Let steps on the disk of this process fail, as `rng` says."""

    def fails() -> bool:
        return rng.random() < _FAULTS

    def failing(step: Callable[..., Any], error: type[Exception]) -> Callable[..., Any]:
        def may_fail(*arguments: Any, **more: Any) -> Any:
            if fails():
                raise error("before it was done")
            result = step(*arguments, **more)
            if fails():
                raise error("after it was done")
            return result

        return may_fail

    real_fsync = os.fsync

    def fsync(descriptor: int) -> None:
        if fails():
            size_bytes = os.fstat(descriptor).st_size
            if rng.random() < 0.5:
                _cut(descriptor, rng.randrange(size_bytes + 1))
            raise OSError(5, "the disk has a fault")
        real_fsync(descriptor)

    for place, name, step in (
        (os, "fsync", fsync),
        (Path, "replace", failing(Path.replace, OSError)),
        (JournalFile, "commit", failing(JournalFile.commit, sqlite3.OperationalError)),
    ):
        mock.patch.object(place, name, step).start()


def _cut(descriptor: int, size_bytes: int) -> None:
    with contextlib.suppress(OSError):  # a folder, or open for reading
        os.ftruncate(descriptor, size_bytes)


async def live(life: Life, rng: random.Random) -> None:
    """Run a node, and have it do something, until the process is killed."""
    folder, reliable = Path(life.folder), Qos(reliability=Reliability.RELIABLE, depth=20)
    table = StreamTable(
        [
            TopicSpec(stream_id=NAV, name="{node}/nav"),
            TopicSpec(stream_id=LOG, name="{node}/log", qos=reliable),
            ServiceSpec(stream_id=ARM, name="arm", server=2, timeout_s=300),
        ],
        nodes={1: "auv", 2: "shore", 3: "buoy"},
    )
    node = LinkNode(
        address=ADDRESS,
        table=table,
        link=DeafLink(),
        beside={"radio": DeafLink()},
        rules=_RULES,
        journal=journal_in(folder / "journal", ADDRESS),
        security=SecuritySpec(source="test", key=folder / "fleet.key", lives=folder / "lives"),
    )
    prepared = await node.prepare()
    runner = prepared.make_runner()
    await runner.start()
    while True:
        act(runner, rng)
        await asyncio.sleep(rng.choice((0.0, 0.0, 1e-3)))


def act(runner: LinkRunner, rng: random.Random) -> None:
    """Do one thing."""
    drawn = rng.randrange(100)
    with contextlib.suppress(ZacousticError):  # a full queue, a stream that is there, no engine now
        if drawn < 50:
            runner.apply(lambda engine, now: engine.publish(NAV, b"position", now))
        elif drawn < 70:
            runner.apply(lambda engine, now: engine.publish(LOG, b"report", now))
        elif drawn < 80:
            runner.apply(lambda engine, now: engine.call(ARM, b"arm", now))
        elif drawn < 94:
            command = RemoteCommand(kind=CommandKind.ASK)
            target = rng.choice((2, 3))
            runner.apply(lambda engine, now: engine.commands.send(target, command, now))
        elif drawn < 97:
            number = rng.choice(_DECLARED)
            spec = TopicSpec(stream_id=number, name=f"more/{number}")
            runner.apply(lambda engine, now: engine.declare(spec, now))
        elif drawn < 98:
            runner.submit(_fault)


def _fault(engine: Engine, now: int) -> None:
    raise RuntimeError("a fault of the engine")


def _child(life: Life, log: int) -> NoReturn:
    _log[0] = log
    rng = random.Random(life.seed)
    mock.patch.object(ccm, "AESCCM", Logged).start()
    logging.disable()
    if life.is_faulty:
        spoil_disk(rng)
    try:
        asyncio.run(live(life, rng))
    except (ZacousticError, OSError):
        while True:  # the node does not start on this disk
            signal.pause()
    except BaseException:
        traceback.print_exc()
    os._exit(1)


def let_live(life: Life) -> Ended:
    """Fork, kill the child when its time is over, and return what it has logged."""
    ours, theirs = os.pipe()
    child = os.fork()
    if not child:
        os.close(ours)
        _child(life, theirs)
    os.close(theirs)
    ends_at, pairs = time.monotonic() + life.lasts_s, bytearray()
    while (left_s := ends_at - time.monotonic()) > 0:
        if select.select([ours], [], [], left_s)[0]:
            got = os.read(ours, 1 << 16)
            if not got:
                break  # it has ended by itself
            if life.after_s is not None and not pairs:
                ends_at = time.monotonic() + life.after_s
            pairs += got
    os.kill(child, signal.SIGKILL)
    while got := os.read(ours, 1 << 16):
        pairs += got
    os.close(ours)
    _, status = os.waitpid(child, 0)
    return Ended(pairs=bytes(pairs), status=status)


def main() -> None:
    """Serve until the input ends."""
    for line in sys.stdin.buffer:
        ended = let_live(msgspec.json.decode(line, type=Life))
        sys.stdout.buffer.write(msgspec.json.encode(ended) + b"\n")
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
