"""Frames that no key of the fleet has made, and a sealed node that hears them."""

import random
import time
from collections.abc import Iterator
from functools import partial
from typing import Final

import msgspec

from tests.virtual.fleet import line
from tests.virtual.sealed import SealedFleet
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import PeerSeen, SealAlarm
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.seal import LONG_HEAD_BYTES
from zacoustic.testing.virtual import VirtualNetwork

NAV: Final = 10
ARM: Final = 20
STRONG: Final = 0x20
"""Bit of a long head, in its first byte: the tag has eight bytes."""
LONG: Final = 0x80
MTU_BYTES: Final = 64
_STORM_S: Final = 1000.0
_GUST: Final = 256
"""Frames of one instant."""
_HOUR_S: Final = 3600.0


class Heard(msgspec.Struct, frozen=True):
    """A frame, as a link hands it on."""

    frame_bytes: bytes
    source: int
    destination: int

    @property
    def is_strong(self) -> bool:
        """Its tag has eight bytes."""
        return self.frame_bytes[0] & (LONG | STRONG) == LONG | STRONG


class Victim:
    """Node 2 of a sealed fleet: it was off while half of the frames of node 1 were sent."""

    def __init__(self) -> None:
        table = StreamTable(
            [TopicSpec(stream_id=NAV, name="{node}/nav"),
             ServiceSpec(stream_id=ARM, name="arm", server=2, timeout_s=60)],
            nodes={1: "shore", 2: "auv", 3: "buoy"},
        )  # fmt: skip
        self.sent: list[Heard] = []
        """All that node 1 has sent to node 2, or to all."""
        self._network = network = VirtualNetwork(
            line(0, 800, 1500), table, build=SealedFleet(), trace=self._note, digest=False
        )
        for number in range(60):
            network.at(5.0 + 10.0 * number, partial(network.publish, 1, NAV, b"%10d" % number))
            if number % 4 == 0:
                network.at(7.0 + 10.0 * number, partial(network.apply, 1, _arm))
        network.at(302.0, partial(network.crash, 2))
        network.at(_STORM_S - 100.0, partial(network.start, 2))
        network.run(until_s=_STORM_S)
        self.peers_seen = sum(
            isinstance(event, PeerSeen) and at == 2 for at, event in network.events
        )
        """How often node 2 was told of another node."""

    def hear(self, frames: Iterator[Heard], number: int) -> float:
        """Hear so many frames, and let an hour go by; see that nothing comes of it.

        Returns:
            Time of the processor that the node took for them, s.
        """
        before, dropped, took_s = self._transmitted(), self._dropped(), 0.0
        self._network.events.clear()
        for gust in range(0, number, _GUST):
            at_s = _STORM_S + 0.25 * gust / _GUST
            heard = [next(frames) for _ in range(min(_GUST, number - gust))]
            self._network.at(at_s, partial(self._network.apply, 2, partial(_hear, heard)))
            began_s = time.process_time()
            self._network.run(until_s=at_s)
            took_s += time.process_time() - began_s
        self._network.run(until_s=at_s + _HOUR_S)
        assert self._transmitted() == before, "somebody has transmitted because of it"
        assert self._dropped() - dropped == number, "one was not refused"
        told = [event for _, event in self._network.events if not isinstance(event, SealAlarm)]
        assert told == []
        return took_s

    def _note(self, record: TraceRecord) -> None:
        if record.what == "transmit" and record.node == 1 and record.peer in (2, BROADCAST):
            self.sent.append(Heard(bytes.fromhex(record.frame), 1, record.peer))

    def _transmitted(self) -> int:
        return sum(stats.frames_transmitted for stats in self._network.stats())

    def _dropped(self) -> int:
        return sum(self._network.engine(2).stats.dropped.values())


def random_frames(sent: list[Heard], rng: random.Random, *, strong: bool) -> Iterator[Heard]:
    """Yield random bytes; every other one has a good head, as of a frame that was sent.

    Args:
        sent: What was sent.
        rng: Draws.
        strong: Their tags have eight bytes.
    """
    heads = [each.frame_bytes[:LONG_HEAD_BYTES] for each in sent if each.is_strong is strong]
    while True:
        frame = bytearray(rng.randbytes(rng.randint(1, MTU_BYTES)))
        if rng.random() < 0.5:
            head = rng.choice(heads)
            head = head if head[0] & LONG else head[:1]
            frame[: len(head)] = head
        elif strong:
            frame[0] |= LONG | STRONG
        source, destination = rng.choice((1, 1, 3, rng.randint(1, 254))), rng.choice((2, BROADCAST))
        if source != 2:
            yield Heard(bytes(frame), source, destination)


def changed_frames(sent: list[Heard], rng: random.Random, *, strong: bool) -> Iterator[Heard]:
    """Yield frames that were sent, heard or not, changed in a way that needs no key.

    Args:
        sent: What was sent.
        rng: Draws.
        strong: They had a tag of eight bytes.
    """
    genuine = set(sent)
    own = [each for each in sent if each.is_strong is strong]
    while True:
        changed = _changed(rng.choice(own), rng.choice(own), rng)
        if changed not in genuine:
            yield changed


def _changed(frame: Heard, other: Heard, rng: random.Random) -> Heard:
    content = bytearray(frame.frame_bytes)
    place = rng.randrange(1, len(content))
    match rng.randrange(6):
        case 0:  # bits
            for _ in range(rng.randint(1, 8)):
                content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        case 1:  # its head alone
            content[rng.randrange(min(LONG_HEAD_BYTES, len(content)))] ^= rng.randint(1, 255)
        case 2:  # cut
            content = content[:place]
        case 3:  # lengthened
            content += rng.randbytes(rng.randint(1, MTU_BYTES - len(content)))
        case 4:  # spliced
            content = content[:place] + other.frame_bytes[place:]
        case _:  # to somebody else, or in the name of somebody else
            destination = 2 if frame.destination == BROADCAST else BROADCAST
            return rng.choice(
                (
                    msgspec.structs.replace(frame, destination=destination),
                    msgspec.structs.replace(frame, source=3),
                )
            )
    return msgspec.structs.replace(frame, frame_bytes=bytes(content))


def _hear(frames: list[Heard], engine: Engine, now: int) -> None:
    for each in frames:
        engine.handle_frame(
            ReceivedFrame(
                frame_bytes=each.frame_bytes,
                source=each.source,
                destination=each.destination,
                received_at=now,
            ),
            now,
        )


def _arm(engine: Engine, now: int) -> None:
    engine.call(ARM, b"arm", now)
