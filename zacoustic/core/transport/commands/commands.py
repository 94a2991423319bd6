"""The commands of one node: those that it gives, and those that it executes."""

from collections.abc import Callable
from typing import Any, Final, assert_never

import msgspec

from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.base.qos import Priority
from zacoustic.core.schedule.context import NodeContext
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.streams.commands import (
    COMMANDS_STREAM_ID,
    SERIALS,
    CommandKind,
    CommandState,
    RemoteCommand,
    check_timeout,
)
from zacoustic.core.transport.calls.answering import ANSWER_LANE
from zacoustic.core.transport.calls.calls import RequestReceived
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.transport.commands.deduplication import DeduplicationTable, Freshness
from zacoustic.core.transport.commands.given import GivenCommands
from zacoustic.core.transport.commands.overrides import Overrides
from zacoustic.core.transport.commands.unproved import Unproved
from zacoustic.core.transport.exchanges.repeating import UNPROVED_S
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.errors import LocalError

NOBODY: Final = 0
"""The address of a command from the node's own network or program."""


class StreamOverridden(msgspec.Struct, frozen=True, kw_only=True):
    """A command has overridden how a topic of this node is sent, and the override is journalled."""

    stream_id: int
    """The topic's stream."""
    on: bool
    """Whether its samples are sent; otherwise they wait, expire and are superseded."""
    min_interval_s: float
    """Minimum time between two transmitted samples of one key, s."""
    priority: Priority
    """The Zenoh priority."""
    commanded_by: int
    """Address of the commanding node; 0: a local command."""
    changed_at: int
    """Instant, ns."""


class CommandHandled(msgspec.Struct, frozen=True, kw_only=True):
    """A command from another node that changes something was executed, or any was refused."""

    commanded_by: int
    """Address of the commanding node."""
    kind: CommandKind | None
    """The kind of command; None: it was refused."""
    stream_id: int | None
    """The topic of the command, or None."""
    refusal: str
    """The reason for the refusal, one line; empty: it was executed."""
    handled_at: int
    """Instant, ns."""


class Commands:
    """The commands that a node gives and executes.

    Args:
        node: The components that all links of the node share.
        services: Carry the commands; None: the wire carries none.
        overrides: The overrides of topics.
        silence: The transmit silence of the node.
        executes: Addresses of the nodes whose commands it executes; None: all nodes of the table.
    """

    def __init__(
        self,
        node: NodeContext,
        services: Services | None,
        overrides: Overrides,
        silence: Silence,
        executes: frozenset[int] | None,
    ) -> None:
        self.overrides = overrides
        """The overrides of topics; read only."""
        self._address = node.address
        self._table = node.table
        self._executes = executes
        self._services = services
        self._handshake = node.handshake
        self._lives = node.lives
        self._alarms = node.alarms if node.seal is not None else None
        self._silence = silence
        self._deduplication = DeduplicationTable(node.stored, node.journal)
        self._emit: Callable[[StreamOverridden | CommandHandled], None] = node.emit
        self._unproved = Unproved(node.timers)
        self._given = GivenCommands(self._give, node.handshake)
        self._serial = 0
        node.peers.forgotten.connect(self._deduplication.peer_forgotten)
        stream = node.table.get(COMMANDS_STREAM_ID)
        if stream is not None and stream.is_built_in:  # otherwise the id belongs to another service
            self._carrier.serve_here(COMMANDS_STREAM_ID, self._receive)
            self._carrier.take_ends(COMMANDS_STREAM_ID, self._given.ended)

    def send(
        self, node: int, command: RemoteCommand, now: int, *, timeout_s: float | None = None
    ) -> int:
        """Give a command to another node; return the call id of its answer.

        The answer is a `ResponseReceived` of stream `COMMANDS_STREAM_ID`, which
        `CommandState.from_wire` decodes, or a `CallFailed`: HANDLER with the reason when the node
        refuses the command.

        Args:
            node: Address of the node, 1…254.
            command: The command.
            now: The instant.
            timeout_s: How long to try, s, at most 600; None: 600.

        Raises:
            LocalError: No such node, or this node itself; the time-out is too long; or the table
                has no remote commands.
            QueueFullError: Too many commands to that node are under way.
        """
        if not 1 <= node <= 254:
            raise LocalError(f"node {node}; allowed: 1..254")
        if timeout_s is not None:
            check_timeout(timeout_s)
        rival = None if self._services is None else self._table.by_id(COMMANDS_STREAM_ID)
        if rival is not None and not rival.is_built_in:
            raise LocalError(
                f"stream {COMMANDS_STREAM_ID} is {rival.name}, so no commands cross the channel",
                hint="give that stream another id",
            )
        if command.changes:
            self._serial = (self._serial + 1) % SERIALS
        return self._given.give(node, command, self._serial, now, timeout_s=timeout_s)

    def execute(
        self, command: RemoteCommand, now: int, then: Callable[[CommandState], None]
    ) -> None:
        """Execute a local command.

        Args:
            command: The command.
            now: The instant.
            then: Takes the resulting state, once it is journalled.

        Raises:
            LocalError: It names a topic that this node does not publish.
        """

        def kept(at: int) -> None:
            self._tell(command, NOBODY, at)
            then(self.state(command, at))

        self._do(command, now, kept)
        if command.changes:
            self._unproved.settle(command.subject)

    def state(self, command: RemoteCommand, now: int) -> CommandState:
        """Return the state of a command's objects.

        Raises:
            LocalError: It names a topic that this node does not publish.
        """
        silence = self._silence.state(now)
        state = CommandState(
            silent=silence.is_silent,
            commanded=silence.is_commanded,
            left_s=None if silence.ends_at is None else ns_to_seconds(silence.ends_at - now),
        )
        if command.stream_id is None:
            return state
        on, qos = self.overrides.effective(self.overrides.check(command.stream_id))
        return msgspec.structs.replace(
            state, on=on, min_interval_s=qos.min_interval_s, priority=qos.priority
        )

    # For the channel

    def _receive(self, request: RequestReceived, now: int) -> None:
        """Take a command from another node."""
        call, age_s = request.call, request.age_s or 0.0
        executes = self._table.nodes if self._executes is None else self._executes
        if call.client not in executes:
            if self._alarms is not None:
                self._alarms.forbidden(call.client, COMMANDS_STREAM_ID, now)
            self._refuse(
                call, f"node {self._address} accepts no commands from node {call.client}", now
            )
            return
        try:
            serial, command = RemoteCommand.from_wire(request.value)
            if command.for_s is not None:
                command = _for_the_rest(command, age_s)
            if command.changes:
                is_former = self._lives.is_over(call.client, call.epoch, now)
                proved = not is_former and self._handshake.is_present(request.value["heard"])
                self._execute_once(call, serial, command, now, proved=proved)
            else:
                self._answer(call, command, now)
        except (ValueError, LocalError) as error:
            self._refuse(call, str(error), now)

    def _execute_once(
        self, call: CallKey, serial: int, command: RemoteCommand, now: int, *, proved: bool
    ) -> None:
        """Execute a command unless it, or a later one, has been executed."""
        subject = command.subject
        freshness = self._deduplication.freshness(call.client, subject, call.epoch, serial)
        tried = self._unproved.freshness(call, subject, serial)
        if freshness is Freshness.NEW and not proved:
            freshness = tried
        if freshness is Freshness.OVERTAKEN:
            raise LocalError("overtaken by a later order")
        if freshness is Freshness.SAME:
            self._answer(call, command, now)
            return
        begins_silence = command.kind is CommandKind.SILENCE and (
            not self._silence.is_silent(now) or tried is Freshness.SAME
        )

        def kept(at: int) -> None:
            self._answer(call, command, at)
            if begins_silence:
                lane = (COMMANDS_STREAM_ID, ANSWER_LANE, call.client)
                self._silence.grant(lane, until=at + self._handshake.owing.patience_ns)

        if not proved:
            undo = self._try(command, now, kept)
            self._unproved.enter(call, subject, serial, undo, now)
            self._tell(command, call.client, now)
            return
        is_told = tried is Freshness.SAME
        self._do(command, now, lambda at: None if is_told else self._tell(command, call.client, at))
        self._unproved.settle(subject)
        # After its effect, so that the journal has the effect when it has this entry.
        self._deduplication.enter(call.client, subject, call.epoch, serial, kept)

    def _answer(self, call: CallKey, command: RemoteCommand, now: int) -> None:
        self._carrier.reply(call, self.state(command, now).to_wire(), now)
        if command.changes:
            self._note(call.client, command, "", now)

    def _refuse(self, call: CallKey, reason: str, now: int) -> None:
        self._carrier.reply_error(call, CallFailure.HANDLER, reason, now)
        self._note(call.client, None, reason, now)

    def _note(self, by: int, command: RemoteCommand | None, refusal: str, now: int) -> None:
        """Emit the event of a command that was executed or refused."""
        self._emit(
            CommandHandled(
                commanded_by=by,
                kind=None if command is None else command.kind,
                stream_id=None if command is None else command.stream_id,
                refusal=refusal,
                handled_at=now,
            )
        )

    # Below the methods above

    @property
    def _carrier(self) -> Services:
        if self._services is None:
            raise LocalError(f"no commands cross a link with wire: {self._table.wire.value}")
        return self._services

    def _give(self, node: int, request: dict[str, Any], now: int, timeout_s: float | None) -> int:
        return self._carrier.call(
            COMMANDS_STREAM_ID, request, now, timeout_s=timeout_s, server=node
        )

    def _try(
        self, command: RemoteCommand, now: int, then: Callable[[int], None]
    ) -> Callable[[int], None]:
        """Execute a command for a while; return what restores the state before it."""
        if command.stream_id is not None:
            self.overrides.change_for_now(command)
            then(now)
            stream_id = command.stream_id
            return lambda at: self.overrides.restore(stream_id)
        was_commanded, until = self._silence.commanded
        if command.kind is CommandKind.RESUME:
            self._silence.resume(now, then=then)
        else:
            for_s = UNPROVED_S if command.for_s is None else min(command.for_s, UNPROVED_S)
            self._silence.begin_at_least(now, until=now + seconds_to_ns(for_s), then=then)

        def restore(at: int) -> None:
            if was_commanded:
                self._silence.begin_at_least(at, until=until, then=lambda at: None)

        return restore

    def _do(self, command: RemoteCommand, now: int, then: Callable[[int], None]) -> None:
        match command.kind:
            case CommandKind.ASK:
                self.state(command, now)  # raises now what it would raise later
                then(now)
            case CommandKind.SILENCE:
                self._silence.begin(now, duration_s=command.for_s, then=then)
            case CommandKind.RESUME:
                self._silence.resume(now, then=then)
            case CommandKind.OVERRIDE | CommandKind.RESET:
                self.overrides.change(command, then)
            case _:
                assert_never(command.kind)

    def _tell(self, command: RemoteCommand, by: int, now: int) -> None:
        """Emit the event of an overridden topic; `Silence` emits its own."""
        if command.kind not in (CommandKind.OVERRIDE, CommandKind.RESET):
            return
        assert command.stream_id is not None
        on, qos = self.overrides.effective(self._table.by_id(command.stream_id))
        self._emit(
            StreamOverridden(
                stream_id=command.stream_id,
                on=on,
                min_interval_s=qos.min_interval_s,
                priority=qos.priority,
                commanded_by=by,
                changed_at=now,
            )
        )


def _for_the_rest(command: RemoteCommand, age_s: float) -> RemoteCommand:
    """Return a silence that ends on time, however long the command took to arrive.

    Raises:
        LocalError: Its time is over.
    """
    assert command.for_s is not None
    try:
        return RemoteCommand(kind=command.kind, for_s=command.for_s - age_s)
    except ValueError:
        raise LocalError("it came when its time was over") from None
