"""This node's subscriptions at the publishers of on-demand topics, and who knows them."""

from collections.abc import Iterable

from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import NO_STREAM, Cause
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.transport.exchanges.repeating import Repeater, Repetition
from zacoustic.core.wire.subscriptions import SUBSCRIBE_CODE, Subscribe, bits_of, page_of

SUBSCRIBE_LANE = 0
ANSWER_LANE = 1
SUBSCRIBE_QOS = Qos(priority=Priority.INTERACTIVE_HIGH)
"""A person may be waiting for the samples that a subscribe message asks for."""


class _Message:
    """The subscribe messages to one node about one page."""

    __slots__ = (
        "bits", "heard", "known_at", "known_bits", "known_version", "repetition", "said_version",
        "version",
    )  # fmt: skip

    def __init__(self) -> None:
        self.bits = 0
        """The streams that this node wants, one bit each."""
        self.version = 0
        """The version that `repetition` sends."""
        self.said_version: int | None = None
        """The last version that the node may have heard; None: none."""
        self.repetition: Repetition | None = None
        """Sends the message until the node answers."""
        self.known_version: int | None = None
        """The last version that the node has answered in its present boot epoch."""
        self.known_bits = 0
        self.known_at = 0
        self.heard: int | None = None
        """The node's boot epoch in the last message."""

    @property
    def is_known(self) -> bool:
        """Whether the node has answered the last message, and that is the present state."""
        return self.known_version is not None and (self.known_version, self.known_bits) == (
            self.said_version,
            self.bits,
        )

    def next_version(self, versions: int) -> int:
        """Return the version of the next message, of so many versions."""
        return 1 if self.said_version is None else (self.said_version + 1) % versions


class Own:
    """The subscriptions of one node at others.

    Args:
        repeater: Repeats subscribe messages.
        handshake: Knows the boot epochs of other nodes.
        versions: How many versions messages have.
    """

    def __init__(self, repeater: Repeater, handshake: Handshake, versions: int) -> None:
        self._versions = versions
        self._repeater = repeater
        self._handshake = handshake
        self._wanted: dict[int, frozenset[int]] = {}
        self._messages: dict[tuple[int, int], _Message] = {}

    def wanted(self, stream_id: int) -> frozenset[int]:
        """Return the publishers at which this node subscribes to a topic."""
        return self._wanted.get(stream_id, frozenset())

    def want(self, stream_id: int, sources: Iterable[int], now: int) -> None:
        """Subscribe to a topic at these publishers, and at no others."""
        before, after = self.wanted(stream_id), frozenset(sources)
        self._wanted[stream_id] = after
        for source in sorted(before ^ after):
            self._write(source, page_of(stream_id), now)

    def answered(self, source: int, answer: Subscribe, now: int) -> str | None:
        """Take an answer; return why it is dropped, or None."""
        message = self._messages.get((source, answer.page))
        if message is None or message.repetition is None or not message.repetition.tries:
            return "unexpected_ack"  # nothing was sent in this boot epoch
        if (answer.version, answer.streams) != (message.version, message.bits):
            return "unexpected_ack"
        if not self._handshake.is_present(answer.heard):
            return "unexpected_ack"  # from a node that has not heard this boot epoch
        if not answer.is_kept:
            self._prove(source, message, now)
            return None
        self._stop(message, message.repetition, now, answered=True)
        message.known_version, message.known_bits = answer.version, answer.streams
        message.known_at = now
        return None

    def sample_received(self, source: int, stream_id: int, now: int, *, is_alone: bool) -> None:
        """Tell `source` again, if needed, that this node does not subscribe to its sample."""
        if source in self.wanted(stream_id):
            return
        key = (source, page_of(stream_id))
        message = self._messages.setdefault(key, _Message())
        if message.repetition is not None or (message.said_version is not None and not is_alone):
            return
        if message.is_known and now < message.known_at + self._handshake.settling_ns:
            return  # the sample was sent before the node knew
        self._say(key, message, message.next_version(self._versions), now)

    def publisher_restarted(self, source: int, now: int) -> None:
        """Send the subscriptions again to a node whose new epoch may have forgotten them."""
        for key, message in self._messages.items():
            if key[0] == source:
                message.known_version = None
                if message.repetition is None and message.bits:
                    assert message.said_version is not None
                    self._say(key, message, message.said_version, now)

    def peer_forgotten(self, source: int, now: int) -> None:
        """Forget a node and the messages to it."""
        for place in [place for place in self._messages if place[0] == source]:
            message = self._messages.pop(place)
            if message.repetition is not None:
                self._stop(message, message.repetition, now)

    # Below the methods above

    def _prove(self, source: int, message: _Message, now: int) -> None:
        """Repeat the message with the node's boot epoch: without it the node drops it later."""
        assert message.repetition is not None
        if message.heard == self._handshake.heard_epoch(source):
            self._handshake.ask(source, now)  # the node has another epoch
            return
        page = next(page for (node, page), each in self._messages.items() if each is message)
        self._stop(message, message.repetition, now, answered=True)
        self._say((source, page), message, message.version, now, proves=True)

    def _write(self, source: int, page: int, now: int) -> None:
        """Bring the message to a node up to date."""
        bits = bits_of(
            stream_id
            for stream_id, sources in self._wanted.items()
            if page_of(stream_id) == page and source in sources
        )
        key = (source, page)
        message = self._messages.get(key)
        if message is None:
            message = self._messages[key] = _Message()
        elif message.bits == bits:
            return
        if message.repetition is not None:
            self._stop(message, message.repetition, now)
        message.bits = bits
        if not message.is_known and (bits or message.said_version is not None):
            self._say(key, message, message.next_version(self._versions), now)

    def _say(
        self,
        key: tuple[int, int],
        message: _Message,
        version: int,
        now: int,
        *,
        proves: bool = False,
    ) -> None:
        source, page = key
        message.version = version
        message.heard = self._handshake.heard_epoch(source)
        record = QueuedRecord(
            stream_id=NO_STREAM,
            code=SUBSCRIBE_CODE,
            destination=source,
            payload=Subscribe(page, version, message.bits, heard=message.heard).body,
            delimits_itself=True,
            for_one_node=True,
            cause=Cause.SUBSCRIBE,
            queued_at=now,
        )
        lane = (NO_STREAM, SUBSCRIBE_LANE, source, page)
        message.repetition = self._repeater.start(
            lane, record, SUBSCRIBE_QOS, until=None, proves=proves
        )

    def _stop(
        self, message: _Message, repetition: Repetition, now: int, *, answered: bool = False
    ) -> None:
        if repetition.tries:
            message.said_version = message.version
        self._repeater.stop(repetition, now, answered=answered)
        message.repetition = None
