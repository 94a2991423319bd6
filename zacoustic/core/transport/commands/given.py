"""The commands that a node gives, each with the other node's boot epoch once that is heard.

A command that does not prove that its sender has heard the node holds there for ten minutes
(`zacoustic.core.transport.commands.unproved`). If the answer shows that the epoch was unknown or
wrong, the sender sends the same command once more, with the epoch and under the same serial.
"""

from collections.abc import Callable
from typing import Any

import msgspec

from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.streams.commands import COMMANDS_TIMEOUT_S, CommandKind, RemoteCommand
from zacoustic.core.transport.calls.calls import CallEvent, CallFailed, ResponseReceived
from zacoustic.errors import LocalError

Give = Callable[[int, dict[str, Any], int, float | None], int]
"""``(node, request, now, timeout_s)``: calls a node and returns the call id."""


class _Given(msgspec.Struct, frozen=True):
    """A command under way."""

    node: int
    command: RemoteCommand
    serial: int
    heard: int | None
    """The node's boot epoch in the command."""
    given_at: int
    ends_at: int
    """Instant until which its answer is awaited, ns."""
    first_id: int | None
    """The call that sent the same command without the right epoch; None: this is the first call."""


class GivenCommands:
    """The commands of one node that are under way.

    Args:
        give: Sends a command.
        handshake: Knows the boot epochs of other nodes.
    """

    def __init__(self, give: Give, handshake: Handshake) -> None:
        self._give = give
        self._handshake = handshake
        self._under_way: dict[int, _Given] = {}

    def give(
        self, node: int, command: RemoteCommand, serial: int, now: int, *, timeout_s: float | None
    ) -> int:
        """Give a command; return the call id of its answer."""
        ends_at = now + seconds_to_ns(COMMANDS_TIMEOUT_S if timeout_s is None else timeout_s)
        given = _Given(node, command, serial, self._epoch_of(node), now, ends_at, None)
        return self._send(given, now, timeout_s)

    def ended(self, event: CallEvent, now: int) -> CallEvent | None:
        """Return the event to emit for the end of a call, or None."""
        if not isinstance(event, ResponseReceived | CallFailed):
            return event
        given = self._under_way.pop(event.call_id, None)
        if given is None:
            return event
        if given.first_id is not None:
            return msgspec.structs.replace(event, call_id=given.first_id)
        if isinstance(event, CallFailed) or not given.command.changes:
            return event
        return None if self._repeat(given, event, now) else event

    # Below the methods above

    def _epoch_of(self, node: int) -> int | None:
        return self._handshake.heard_epoch(node)

    def _send(self, given: _Given, now: int, timeout_s: float | None) -> int:
        request = given.command.to_wire(given.serial, given.heard)
        call_id = self._give(given.node, request, now, timeout_s)
        others = self._under_way.items()  # a cancelled call has reported no end
        self._under_way = {each: other for each, other in others if now <= other.ends_at}
        self._under_way[call_id] = given
        return call_id

    def _repeat(self, given: _Given, answer: ResponseReceived, now: int) -> bool:
        """Give a command again if its node had another epoch; return whether it was sent."""
        heard, command = self._epoch_of(given.node), given.command
        if heard in (None, given.heard) or now >= given.ends_at:
            return False
        try:
            if command.kind is CommandKind.SILENCE and command.for_s is not None:
                left_s = command.for_s - ns_to_seconds(now - given.given_at)
                command = RemoteCommand(kind=command.kind, for_s=left_s)
            again = msgspec.structs.replace(
                given, command=command, heard=heard, first_id=answer.call_id
            )
            self._send(again, now, ns_to_seconds(given.ends_at - now))
        except (ValueError, LocalError):  # too late, or too many calls under way
            return False
        return True
