"""The vehicle on its network: topics, services, and an action that is three of these.

The vehicle knows messages by the names of `messages`, and maps. A `Speech` says where they are and
in what bytes: `ZenohSpeech` keys and CBOR, `examples.auv.rosspeech.RosSpeech` what nodes of ROS 2
say on rmw_zenoh. Zenoh calls on threads of its own: nothing is read there, but handed to `later`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import msgspec
import zenoh

from examples.auv.session import CBOR, from_cbor, to_cbor

Said = dict[str, Any]
Act = Callable[[], None]
Later = Callable[[Act], None]
"""Has something done by the thread that does everything."""


class Question(ABC):
    """A question to a service; answered once."""

    def __init__(self, asked: Said) -> None:
        self.asked = asked
        """What is asked."""

    @abstractmethod
    def answer(self, said: Said) -> None:
        """Answer it."""


class Speech(ABC):
    """Says and hears what `messages` names."""

    @abstractmethod
    def publish(self, topic: str, said: Said | bytes) -> None:
        """Publish; bytes are what a photo is."""

    @abstractmethod
    def subscribe(self, topic: str, take: Callable[[Said], None]) -> None:
        """Hear a topic."""

    @abstractmethod
    def serve(self, service: str, take: Callable[[Question], None]) -> None:
        """Serve a service."""


class ZenohSpeech(Speech):
    """Keys of Zenoh, and maps in CBOR.

    Args:
        session: Zenoh's.
        later: Where what arrives is done.
    """

    def __init__(self, session: zenoh.Session, later: Later) -> None:
        self._session = session
        self._later = later

    def publish(self, topic: str, said: Said | bytes) -> None:
        """Put."""
        if isinstance(said, bytes):
            self._session.put(topic, said)
        else:
            self._session.put(topic, to_cbor(said), encoding=CBOR)

    def subscribe(self, topic: str, take: Callable[[Said], None]) -> None:
        """Declare a subscriber."""

        def hear(sample: zenoh.Sample) -> None:
            self._later(lambda: take(from_cbor(sample.payload)))

        self._session.declare_subscriber(topic, hear)

    def serve(self, service: str, take: Callable[[Question], None]) -> None:
        """Declare a queryable."""

        def hear(query: zenoh.Query) -> None:
            self._later(lambda: take(_ZenohQuestion(query)))

        self._session.declare_queryable(service, hear)


class _ZenohQuestion(Question):
    def __init__(self, query: zenoh.Query) -> None:
        super().__init__(from_cbor(query.payload))
        self._query = query

    def answer(self, said: Said) -> None:
        """Reply."""
        with self._query as query:
            query.reply(query.key_expr, to_cbor(said), encoding=CBOR)


def said_of(value: msgspec.Struct) -> Said:
    """Return a record as a map."""
    said: Said = msgspec.to_builtins(value)
    return said
