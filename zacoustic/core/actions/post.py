"""Gets what is said about goals onto the queue: once, or again and again."""

import enum
from typing import Final

import msgspec

from zacoustic.core.actions.news import GoalKey
from zacoustic.core.actions.wire import (
    FORMER_BYTES,
    GOAL_NUMBERS,
    Operation,
    decode_refusal,
    encode_head,
)
from zacoustic.core.arq.timing import LinkTimes
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.handshake import Handshake
from zacoustic.core.payload import PayloadCodec
from zacoustic.core.qos import Priority, Qos
from zacoustic.core.queue import LaneKey, TransmitQueue, Waiting
from zacoustic.core.repeating import RepeatedRecord, Repeater, Repetition
from zacoustic.core.stats import Cause
from zacoustic.core.streams import Stream


class GoalLane(enum.IntEnum):
    """The lanes of a stream; other numbers are those of topics and calls."""

    GOAL = 11
    CANCEL = 12
    CLAIM = 13
    ANSWER = 14
    """CONFIRM, ACCEPTED and REFUSED: of each goal the newest."""
    CANCEL_ANSWER = 15
    FEEDBACK = 16
    RESULT = 17


_SHARED: Final = (GoalLane.GOAL, GoalLane.RESULT)
"""Lanes in which the goals between two nodes wait in their order; else each goal has its own."""
_HEADER_BYTES: Final = 2 + FORMER_BYTES
_URGENT: Final = (GoalLane.CANCEL, GoalLane.CANCEL_ANSWER)


class GoalPost:
    """Writes records about goals.

    Args:
        address: Address of this node.
        queue: Takes what is said once.
        repeater: Takes what is repeated.
        handshake: Knows the present epoch of each node.
    """

    def __init__(
        self, address: int, queue: TransmitQueue, repeater: Repeater, handshake: Handshake
    ) -> None:
        self._address = address
        self._queue = queue
        self._repeater = repeater
        self._handshake = handshake
        self._linger_s = 0.0
        self._known_to: dict[int, int] = {}

    def use_link(self, times: LinkTimes) -> None:
        """Take the airtimes of a link."""
        self._linger_s = times.ack_linger_ns / NS_PER_S

    def say(
        self,
        goal: GoalKey,
        stream: Stream,
        peer: int,
        operation: Operation,
        lane: GoalLane,
        now: int,
        payload: bytes = b"",
    ) -> None:
        """Say something once; it takes the place of what waits in its lane."""
        qos = Qos(priority=Priority.INTERACTIVE_HIGH, linger_s=self._linger_s)
        if lane in _URGENT:
            qos = Qos(priority=Priority.REAL_TIME)
        record = Waiting(
            stream_id=stream.stream_id,
            destination=peer,
            head=self._head(goal, operation),
            payload=payload,
            delimits_itself=operation is not Operation.REFUSED,
            for_one_node=True,
            cause=Cause.ACK,
            queued_at=now,
        )
        if not self._queue.fits(record):
            if operation is not Operation.REFUSED:
                return
            record = self._shortened(record)
        self._queue.replace(_lane_key(goal, peer, lane), record, qos)

    def drop_answers(self, stream_id: int) -> None:
        """Take back the answers that wait, to whatever goal of an action."""
        self._queue.drop_lanes((stream_id, GoalLane.ANSWER))

    def feed(
        self, goal: GoalKey, stream: Stream, peer: int, payload: bytes, interval_s: float, now: int
    ) -> None:
        """Send feedback; it takes the place of what waits, and keeps its age."""
        qos = msgspec.structs.replace(
            stream.qos, depth=1, lifespan_s=None, min_interval_s=interval_s
        )
        record = Waiting(
            stream_id=stream.stream_id,
            destination=peer,
            head=self._head(goal, Operation.FEEDBACK),
            payload=payload,
            delimits_itself=stream.feedback_codec.delimits_itself,
            for_one_node=True,
            queued_at=now,
        )
        self._queue.replace(_lane_key(goal, peer, GoalLane.FEEDBACK), record, qos)

    def repeat(
        self,
        goal: GoalKey,
        stream: Stream,
        peer: int,
        operation: Operation,
        lane: GoalLane,
        now: int,
        *,
        payload: bytes = b"",
        codec: PayloadCodec | None = None,
        until: int,
    ) -> Repetition:
        """Say something until it is stopped, or until an instant, ns.

        Args:
            goal: What it is about.
            stream: The action's stream.
            peer: Address of the other end.
            operation: What is said.
            lane: Where it waits.
            now: The instant.
            payload: What follows.
            codec: Codec at the end of the payload; None: there is none.
            until: End, ns.
        """
        qos = msgspec.structs.replace(
            stream.qos, depth=2 * GOAL_NUMBERS, lifespan_s=None, min_interval_s=0.0
        )
        if lane in _URGENT:
            qos = Qos(priority=Priority.REAL_TIME, depth=2 * GOAL_NUMBERS)
        record = RepeatedRecord(
            stream_id=stream.stream_id,
            destination=peer,
            head=self._head(goal, operation),
            payload=payload,
            delimits_itself=codec is None or codec.delimits_itself,
            # Whoever hears what a client says knows who the server is.
            for_one_node=goal.client != self._address,
            queued_at=now,
        )
        return self._repeater.start(_lane_key(goal, peer, lane), record, qos, until=until)

    def stop(self, repetition: Repetition | None, now: int, *, answered: bool = False) -> None:
        """End a repetition, if there is one."""
        if repetition is not None:
            self._repeater.stop(repetition, now, answered=answered)

    def again(self, repetition: Repetition) -> None:
        """Repeat at once: the other end has shown that it lacks the record."""
        self._repeater.again(repetition)

    def withdraw(self, goal: GoalKey, peer: int, *lanes: GoalLane) -> None:
        """Take back what waits to be said of a goal."""
        for lane in lanes:
            self._queue.drop_lane(_lane_key(goal, peer, lane))

    def check_size(self, stream: Stream, payload: bytes, *, status: bool = False) -> None:
        """Refuse a payload that fits no frame, whichever epoch its goal is of.

        Raises:
            PayloadTooLargeError: Says how large it is and how much fits.
        """
        self._queue.check_size(stream.name, _HEADER_BYTES + status + len(payload))

    def fits(self, payload: bytes) -> bool:
        """Tell whether the link has room for a record about a goal with this payload."""
        largest_bytes = self._queue.largest_bytes
        return largest_bytes is None or _HEADER_BYTES + len(payload) <= largest_bytes

    def heard(self, client: int, *, introduced: bool) -> None:
        """A client has said something; not introduced, it knows that its epoch is known here."""
        if not introduced:
            self._known_to[client] = self._handshake.epoch_of(client)

    def needs_no_epoch(self, goal: GoalKey) -> bool:
        """Tell whether the other end takes a record without an epoch for one about this goal.

        A server is sure of that only when the client has been told that its epoch is known: until
        then the record might reach another life, and be taken for one about a goal of that.
        """
        if goal.client == self._address:
            return goal.epoch == self._handshake.epoch
        present = self._handshake.last_epoch(goal.client)
        return goal.epoch == present == self._known_to.get(goal.client)

    def _head(self, goal: GoalKey, operation: Operation) -> bytes:
        epoch = None if self.needs_no_epoch(goal) else goal.epoch
        return encode_head(operation, goal.number, epoch)

    def _shortened(self, refusal: Waiting) -> Waiting:
        """Cut the text of a refusal, to fit the link."""
        assert self._queue.largest_bytes is not None
        room_bytes = self._queue.largest_bytes - (refusal.size_bytes - len(refusal.payload))
        said = decode_refusal(refusal.payload)
        assert said is not None
        return Waiting(
            stream_id=refusal.stream_id,
            destination=refusal.destination,
            head=refusal.head,
            payload=said.encode(room_bytes),
            for_one_node=True,
            cause=Cause.ACK,
            queued_at=refusal.queued_at,
        )


def _lane_key(goal: GoalKey, peer: int, lane: GoalLane) -> LaneKey:
    if lane in _SHARED:
        return (goal.stream_id, lane, peer)
    # Of two epochs never both: a client avoids the numbers that are taken by its former goals.
    return (goal.stream_id, lane, peer, goal.number)
