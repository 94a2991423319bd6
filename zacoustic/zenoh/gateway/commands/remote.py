"""Remote commands from the local network: executed here for this node, else sent to another one.

The keys are those of `zacoustic.zenoh.session.asking.commands`. Each gateway answers for its own
node. For a remote node the local gateway with the lowest address asks, unless that node's own
gateway is local. Commands for unknown nodes are left to other gateways. A query with a wildcard in
place of the address is for the local gateways only: browsing never commands a remote node.

The answer to a command goes out when the executing node has journalled the command.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import Clock, ns_to_seconds, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure, SilenceChanged
from zacoustic.core.streams.commands import CommandState, RemoteCommand
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.encoding import JSON
from zacoustic.errors import LocalError
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.run.permitlog import utc_text
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.commands.refusing import refuse_failed
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.session.asking.commands import (
    PREFIX,
    SUBJECTS,
    Asked,
    SilenceState,
    StreamState,
    read_query,
    read_target,
)
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery

_EVERYWHERE: Final = tuple(f"{PREFIX}/*/{subject}" for subject in SUBJECTS)


class CommandHandler:
    """Takes commands of the local network; for the loop.

    Args:
        table: All streams.
        runner: Its engine executes or sends commands.
        redundant: The local gateways.
        ends: The calls of the gateway.
        clock: Source of instants.
        wall_clock: Returns UTC, ns since 1970.
    """

    def __init__(
        self,
        table: StreamTable,
        runner: LinkRunner,
        redundant: RedundantGateways,
        ends: Pending[CallEnd],
        *,
        clock: Clock,
        wall_clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._table = table
        self._runner = runner
        self._redundant = redundant
        self._clock = clock
        self._wall_clock = wall_clock
        self._ends = ends

    @property
    def own_keys(self) -> tuple[str, ...]:
        """Keys of the commands for this node."""
        return tuple(f"{PREFIX}/{self._redundant.address}/{subject}" for subject in SUBJECTS)

    @property
    def keys_beyond(self) -> tuple[str, ...]:
        """Key expressions that include the commands for other nodes."""
        return _EVERYWHERE

    def serve(self, held: HeldQuery) -> None:
        """Take a query for this node."""
        own = self._redundant.address
        asked = self._read(held, lambda node: node in (None, own))
        if asked is None:
            return

        def execute(engine: Engine, now: int) -> None:
            engine.commands.execute(
                asked.command, now, partial(self._answer, held, own, asked.command)
            )

        try:
            self._runner.apply(execute)
        except LocalError as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))

    def serve_beyond(self, held: HeldQuery) -> None:
        """Take a query for any node."""
        asked = self._read(held, self._is_ours)
        if asked is None or asked.node is None:
            return
        node = asked.node

        def send(engine: Engine, now: int) -> None:
            call_id = engine.commands.send(node, asked.command, now, timeout_s=asked.within_s)
            self._ends.add(call_id, partial(self._answered, held, node, asked.command))

        try:
            self._runner.apply(send)
        except LocalError as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))

    def silence(self, event: SilenceChanged) -> SilenceState:
        """Return the engine's answer in the form of a reply."""
        left_s = None
        if event.ends_at is not None:
            left_s = ns_to_seconds(event.ends_at - self._clock())
        state = CommandState(silent=event.is_silent, commanded=event.is_commanded, left_s=left_s)
        return self._silence(self._redundant.address, state)

    # Below the methods above

    def _read(self, held: HeldQuery, is_for_us: Callable[[int | None], bool]) -> Asked | None:
        """Read a query, or end it; an error reply goes out only if this gateway has to answer."""
        target = read_target(held.key)
        if target is None or not is_for_us(target[0]):
            held.answer([])
            return None
        try:
            return read_query(held.key, held.parameters)
        except ValueError as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))
            return None

    def _is_ours(self, node: int | None) -> bool:
        """Return whether this one of the local gateways asks a remote node."""
        if node is None or node in self._redundant.alive:
            return False
        return self._redundant.asks(node)

    def _answered(self, held: HeldQuery, node: int, command: RemoteCommand, end: CallEnd) -> None:
        if isinstance(end, CallFailed):
            maybe = "may have executed it" if command.changes else ""
            refuse_failed(held, end, node, maybe=maybe)
            return
        state = CommandState.from_wire(end.value, end.age_s)
        self._answer(held, node, command, state)

    def _answer(
        self, held: HeldQuery, node: int, command: RemoteCommand, state: CommandState
    ) -> None:
        document: SilenceState | StreamState
        if command.stream_id is None:
            document = self._silence(node, state)
        else:
            stream = self._table.get(command.stream_id)
            document = StreamState(
                address=node,
                stream=command.stream_id,
                name="" if stream is None else stream.name,
                on=bool(state.on),
                min_interval_s=state.min_interval_s or 0.0,
                priority=state.priority.name.lower() if state.priority else "",
            )
        key = held.key.replace(f"{PREFIX}/*/", f"{PREFIX}/{node}/")
        held.answer([Answer(key=key, payload=msgspec.json.encode(document), encoding=JSON)])

    def _silence(self, node: int, state: CommandState) -> SilenceState:
        until_utc, why = None, ""
        if state.left_s is not None:
            until_utc = utc_text(self._wall_clock() + seconds_to_ns(state.left_s))
        if node == self._redundant.address:
            engine = self._runner.engine
            why = engine.clock.doubt or engine.silence.state(self._clock()).doubt
        return SilenceState(
            address=node,
            silent=state.silent or bool(why),
            commanded=state.commanded,
            until_utc=until_utc,
            left_s=state.left_s,
            why=why,
        )
