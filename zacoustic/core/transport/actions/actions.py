"""The actions of one node, for the application and the channel.

The commands are methods (`Engine.actions`); the events are those of
`zacoustic.core.transport.actions.events`.
"""

from collections.abc import Mapping

from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.client import GoalClient
from zacoustic.core.transport.actions.outbox import GoalOutbox
from zacoustic.core.transport.actions.server import GoalServer
from zacoustic.core.transport.exchanges.repeating import Repeater
from zacoustic.core.wire.frame import Record
from zacoustic.core.wire.goals import GoalFailure, GoalKey, GoalStatus, decode_message
from zacoustic.errors import LocalError, UnknownStreamError


class Actions:
    """The actions of one node, as client and as server.

    Args:
        context: What the components of its engine share.
        repeater: Repeats the records that need an answer.
    """

    def __init__(self, context: Context, repeater: Repeater) -> None:
        self._address = context.address
        self._table = context.table
        self._outbox = outbox = GoalOutbox(
            context.address, context.queue, repeater, context.handshake
        )
        self._client = GoalClient(context, outbox)
        self._server = GoalServer(context, outbox, repeater)
        context.reception.on_records(ActionSpec, self.receive)
        context.epoch.began.connect(self.epoch_changed)
        context.peers.restarted.connect(self.peer_restarted)
        context.peers.differs.connect(self.stream_differs)
        context.peers.forgotten.connect(self.peer_forgotten)

    # Commands of a client

    def send_goal(
        self,
        stream_id: int,
        value: object,
        now: int,
        *,
        timeout_s: float | None = None,
        tag: bytes = b"",
    ) -> GoalKey:
        """Send a goal; `GoalAnswered` follows, and then, if it was accepted, its outcome.

        Args:
            stream_id: The action's stream.
            value: The goal in its type; bytes if it is opaque.
            now: The instant.
            timeout_s: Time for the answer, s, > 0; at most the action's `timeout_s`, which is the
                default.
            tag: Any bytes; `GoalRecovered` returns them after a restart.

        Returns:
            The key of the goal in all later events and commands.

        Raises:
            UnknownStreamError: No such action.
            LocalError: This node is the server.
            PayloadInvalidError: The goal's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
            QueueFullError: Twelve goals of this action are under way.
            JournalUnavailableError: The journal cannot be written.
        """
        stream, spec = self._action(stream_id)
        if spec.server == self._address:
            raise LocalError(f"{stream.name} is served by this node, {self._address}")
        wait_s = spec.timeout_s if timeout_s is None else timeout_s
        return self._client.send(stream, spec, value, now, wait_s, tag)

    def cancel_goal(self, goal: GoalKey, now: int) -> bool:
        """Ask for the end of a goal, ahead of everything that waits; False: it has ended.

        `CancelAnswered` follows, or the outcome of the goal. A goal of which nothing was sent yet
        ends at once.
        """
        return self._client.cancel(goal, now)

    # Commands of a server

    def accept(self, goal: GoalKey, now: int) -> bool:
        """Accept a goal; False: its client no longer waits, and it must not begin."""
        return self._server.accept(goal, now)

    def reject(
        self,
        goal: GoalKey,
        now: int,
        *,
        text: str = "",
        failure: GoalFailure = GoalFailure.REJECTED,
    ) -> bool:
        """Reject a goal; the text is cut to 48 bytes. False: it was answered, or has ended."""
        return self._server.reject(goal, failure, text, now)

    def publish_feedback(self, goal: GoalKey, value: object, now: int) -> bool:
        """Send feedback on a goal; False: it does not run.

        Raises:
            PayloadInvalidError: The feedback's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
        """
        return self._server.feed(goal, value, now)

    def finish(self, goal: GoalKey, status: GoalStatus, value: object, now: int) -> bool:
        """End a goal; False: it does not run.

        Args:
            goal: The goal.
            status: How it ended; UNKNOWN: the component that executed it is gone.
            value: The result; None: none.
            now: The instant.

        Raises:
            PayloadInvalidError: The result's type does not allow the value. The goal is aborted
                without a result.
            PayloadTooLargeError: It fits no frame of this link. The goal is aborted likewise.
        """
        return self._server.finish(goal, status, value, now)

    def answer_cancel(self, goal: GoalKey, now: int, *, accepted: bool, text: str = "") -> bool:
        """Answer a `CancelRequested`; False: it was answered before, or the goal has ended.

        An accepted cancel lets the goal run until `finish`: CANCELED, or whatever outcome it has by
        then.
        """
        return self._server.answer_cancel(goal, accepted, text, now)

    # For the engine

    def use_link(self, times: LinkTimes, settling_ns: int) -> None:
        """Set the link's airtimes, and how long a frame and all its duplicates take to come, ns."""
        self._outbox.use_link(times)
        self._client.settling_ns = self._server.settling_ns = settling_ns

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the goals that the journal has."""
        self._client.recover(stored)
        self._server.recover(stored)

    def link_up(self, now: int) -> None:
        """Ask for and repeat what is left from before the restart: the link is up."""
        self._client.link_up(now)
        self._server.link_up(now)

    def epoch_changed(self, now: int) -> None:
        """Send the client's goals again as goals of an earlier epoch."""
        self._client.epoch_changed(now)

    def receive(self, heard: Heard, stream: Stream, record: Record) -> str | None:
        """Take a record that may be decoded; return why it is dropped, or None."""
        spec, source, now = stream.spec, heard.source, heard.now
        assert isinstance(spec, ActionSpec)
        message = decode_message(record.content, from_client=spec.server == self._address)
        if message is None:
            return "payload"
        if spec.server == self._address:
            return self._server.receive(source, stream, message, now)
        if spec.server == source and not heard.is_unicast:
            return "not_for_us"  # it may be about a goal of another client
        if spec.server == source:
            return self._client.receive(source, stream, message, now)
        return "not_subscriber"

    def stream_differs(self, server: int, stream_id: int, now: int) -> None:
        """Fail the goals of an action that its server defines differently."""
        self._client.stream_differs(server, stream_id, now)

    def peer_restarted(self, peer: int, epoch: int, now: int) -> None:
        """Adjust the goals with a node that has begun a new epoch."""
        self._server.client_restarted(peer, now)
        self._client.server_restarted(peer, now)

    def peer_forgotten(self, peer: int, now: int) -> None:
        """Forget the goals of a client; the goals sent to it continue."""
        self._server.client_forgotten(peer, now)

    # Below the methods above

    def _action(self, stream_id: int) -> tuple[Stream, ActionSpec]:
        stream = self._table.by_id(stream_id)
        if not isinstance(stream.spec, ActionSpec):
            raise UnknownStreamError(f"stream {stream_id} ({stream.name}) is not an action")
        return stream, stream.spec
