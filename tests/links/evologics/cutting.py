"""The same bytes to a decoder in different pieces."""

import random
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Protocol

from zacoustic_evologics.at.messages import RawData


class Decoder(Protocol):
    def feed(self, received: bytes) -> Sequence[Any]: ...


def one_by_one(stream: bytes) -> Iterator[bytes]:
    return (stream[place : place + 1] for place in range(len(stream)))


def at_random(stream: bytes, seed: int) -> Iterator[bytes]:
    rng = random.Random(seed)
    place = 0
    while place < len(stream):
        length = rng.choice((1, 2, 3, 7, 20, 100, 1000))
        yield stream[place : place + length]
        place += length


def decoded(decoder: Decoder, pieces: Iterable[bytes]) -> list[Any]:
    """Give the messages, those of raw data that follow each other joined."""
    messages: list[Any] = []
    for piece in pieces:
        for message in decoder.feed(piece):
            if isinstance(message, RawData) and messages and isinstance(messages[-1], RawData):
                messages[-1] = RawData(messages[-1].content + message.content)
            else:
                messages.append(message)
    return messages
