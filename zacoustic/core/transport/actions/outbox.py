"""Queues records about goals, once or repeated."""

import enum
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.schedule.queue import LaneKey, QueuedRecord, TransmitQueue
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.exchanges.records import once_qos, repeated_qos
from zacoustic.core.transport.exchanges.repeating import Repeater, Repetition
from zacoustic.core.values.payload import PayloadCodec
from zacoustic.core.wire.goals import (
    FORMER_BYTES,
    REMINDER,
    GoalKey,
    Operation,
    decode_refusal,
    encode_head,
)


class GoalLane(enum.IntEnum):
    """The lanes of an action's stream; topics and calls use other numbers."""

    GOAL = 11
    CANCEL = 12
    CLAIM = 13
    ANSWER = 14
    """CONFIRM, ACCEPTED and REFUSED: for each goal the newest."""
    CANCEL_ANSWER = 15
    FEEDBACK = 16
    RESULT = 17


_SHARED: Final = (GoalLane.GOAL, GoalLane.RESULT)
"""Lanes that all goals between two nodes share, in order; the other lanes hold one goal each."""
_HEADER_BYTES: Final = 2 + FORMER_BYTES
_URGENT: Final = (GoalLane.CANCEL, GoalLane.CANCEL_ANSWER)


class _AboutGoal(QueuedRecord):
    """A record about a goal; whether it carries an epoch is decided when the frame goes."""

    __slots__ = ("heading",)
    heading: Callable[[], bytes]

    def head_at(self, now: int) -> bytes:
        """Return the shortest head that the other end understands by now."""
        return self.heading()


class GoalOutbox:
    """Writes records about goals.

    Args:
        address: Address of this node.
        queue: Takes records that are sent once.
        repeater: Takes repeated records.
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

    def use_link(self, times: LinkTimes) -> None:
        """Set the link's airtimes."""
        self._linger_s = times.confirm_linger_s

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
        """Send a record once, in place of the one that waits in its lane."""
        qos = once_qos(self._linger_s)
        if lane in _URGENT:
            qos = Qos(priority=Priority.REAL_TIME)
        shows_end = operation is not Operation.REFUSED

        def written(payload: bytes) -> QueuedRecord:
            record = self._written(goal, stream, peer, operation, payload, now, shows_end=shows_end)
            record.cause = Cause.ACK
            return record

        record = written(payload)
        if not self._queue.fits(record):
            if shows_end:
                return
            # The text of a refusal is cut to fit the link.
            assert self._queue.largest_bytes is not None
            room_bytes = self._queue.largest_bytes - (record.size_bytes - len(payload))
            refusal = decode_refusal(payload)
            assert refusal is not None
            record = written(refusal.encode(room_bytes))
        self._queue.replace(_lane_key(goal, peer, lane), record, qos)

    def feed(
        self, goal: GoalKey, stream: Stream, peer: int, payload: bytes, interval_s: float, now: int
    ) -> None:
        """Send feedback in place of the one that waits, whose queueing time it keeps."""
        qos = msgspec.structs.replace(
            stream.qos, depth=1, lifespan_s=None, min_interval_s=interval_s
        )
        shows_end = stream.feedback_codec.delimits_itself
        record = self._written(
            goal, stream, peer, Operation.FEEDBACK, payload, now, shows_end=shows_end
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
        is_reminded: bool = False,
    ) -> Repetition:
        """Repeat a record until it is stopped, or until an instant.

        Args:
            goal: The goal.
            stream: The action's stream.
            peer: Address of the other end.
            operation: The record's operation.
            lane: The lane in which it waits.
            now: The instant.
            payload: The bytes after the head.
            codec: Codec at the end of the payload; None: none.
            until: End, ns.
            is_reminded: It is a result that is sent twice; then a reminder of it is repeated.
        """
        qos = Qos(priority=Priority.REAL_TIME) if lane in _URGENT else stream.qos
        # Whoever hears a client's record knows which node is the server.
        is_reply = goal.client != self._address

        def written(operation: Operation, payload: bytes, shows_end: bool) -> QueuedRecord:
            return self._written(
                goal, stream, peer, operation, payload, now, shows_end=shows_end, is_reply=is_reply
            )

        return self._repeater.start(
            _lane_key(goal, peer, lane),
            written(operation, payload, codec is None or codec.delimits_itself),
            repeated_qos(qos),
            until=until,
            reminder=written(Operation.RESULT, REMINDER, True) if is_reminded else None,
        )

    def stop(
        self,
        repetition: Repetition | None,
        now: int,
        *,
        answered: bool = False,
        prompt: bool = False,
    ) -> None:
        """End a repetition, if there is one.

        Args:
            repetition: The repetition, or None.
            now: The instant.
            answered: The other end has just shown that it has the record.
            prompt: It does that at once; otherwise an application has decided when.
        """
        if repetition is not None:
            self._repeater.stop(repetition, now, answered=answered, prompt=prompt)

    def again(self, repetition: Repetition) -> None:
        """Repeat a record at once: the other end lacks it."""
        self._repeater.again(repetition)

    def withdraw(self, goal: GoalKey, peer: int, *lanes: GoalLane) -> None:
        """Remove the waiting records of a goal from the queue."""
        for lane in lanes:
            self._queue.drop_lane(_lane_key(goal, peer, lane))

    def check_size(self, stream: Stream, payload: bytes, *, status: bool = False) -> None:
        """Refuse a payload that fits no frame, in whichever epoch its goal was sent.

        Raises:
            PayloadTooLargeError: States its size and how much fits.
        """
        self._queue.check_size(stream.name, _HEADER_BYTES + status + len(payload))

    def fits(self, payload: bytes) -> bool:
        """Return whether a record about a goal with this payload fits the link."""
        largest_bytes = self._queue.largest_bytes
        return largest_bytes is None or _HEADER_BYTES + len(payload) <= largest_bytes

    def needs_no_epoch(self, goal: GoalKey) -> bool:
        """Return whether the other end relates a record without an epoch to this goal.

        A client does so only if the server has told it, in the same frame or before, that it knows
        the client's epoch: otherwise the record might be meant for another boot epoch.
        """
        if goal.client == self._address:
            return goal.epoch == self._handshake.epoch
        client = self._handshake.peer(goal.client)
        is_told = client.is_assured or client.is_being_confirmed
        return goal.epoch == client.epoch and is_told

    def _head(self, goal: GoalKey, operation: Operation) -> bytes:
        epoch = None if self.needs_no_epoch(goal) else goal.epoch
        return encode_head(operation, goal.number, epoch)

    def _written(
        self,
        goal: GoalKey,
        stream: Stream,
        peer: int,
        operation: Operation,
        payload: bytes,
        now: int,
        *,
        shows_end: bool,
        is_reply: bool = True,
    ) -> QueuedRecord:
        record = _AboutGoal(
            stream_id=stream.stream_id,
            destination=peer,
            # The longest one.
            head=encode_head(operation, goal.number, goal.epoch),
            payload=payload,
            delimits_itself=shows_end,
            for_one_node=is_reply,
            is_reply=is_reply,
            queued_at=now,
        )
        record.heading = partial(self._head, goal, operation)
        return record


def _lane_key(goal: GoalKey, peer: int, lane: GoalLane) -> LaneKey:
    if lane in _SHARED:
        return (goal.stream_id, lane, peer)
    # Never in two epochs: a client avoids the numbers of its goals from earlier epochs.
    return (goal.stream_id, lane, peer, goal.number)
