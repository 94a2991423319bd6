"""Actions: local goals for remote servers, and received goals for local ones.

Each goal passes from one End of the gateway to the other one, and neither knows the other
(`zacoustic.zenoh.ends`). The local id of a goal, 16 bytes, does not cross: on the channel it has a
number. The engine keeps the id as its tag, so a restarted gateway still knows the goal.
"""

from collections.abc import Callable
from functools import partial
from typing import Final

import zenoh

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.actions.events import ActionEvent
from zacoustic.errors import LocalError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.ends.enginegoals import EngineGivenGoal, EngineGoals, EngineTakenGoal
from zacoustic.zenoh.ends.goals import GivenGoal, GoalClient, Passage, TakenGoal
from zacoustic.zenoh.ends.zenohclients import ZenohClients, ZenohTakenGoal
from zacoustic.zenoh.ends.zenohservers import ZenohServers
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.session.asking.goals import GOAL_ID_BYTES
from zacoustic.zenoh.session.asking.queries import HeldQuery
from zacoustic.zenoh.session.marker import Marker
from zacoustic.zenoh.session.session import ZenohSession

PROGRAM_PATIENCE_S: Final = 10.0
"""How long a program that executes a goal, or the router, may be away, s."""
# An answer that is due already has this long, s.
_LEAST_LIMIT_S: Final = 0.001


class Actions:
    """The actions of one gateway; for the loop, except for `ear`.

    Args:
        address: Address of this node.
        table: All streams.
        zenoh_session: The session of the goals.
        input_errors: Takes the errors of local programs.
        dialects: The local forms of actions.
        runner: Drives the engine.
        clock: Source of instants.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        zenoh_session: ZenohSession,
        input_errors: InputErrors,
        dialects: Dialects,
        *,
        runner: LinkRunner,
        clock: Clock,
    ) -> None:
        self._input_errors = input_errors
        self._clock = clock
        self._engine = EngineGoals(runner, table, complain=input_errors.add, recover=self._recover)
        self.deliver: Callable[[ActionEvent], None] = self._engine.deliver
        """Takes an event of the engine."""
        streams = [stream for stream in table if isinstance(stream.spec, ActionSpec)]
        self.forms = {stream.stream_id: dialects.action(stream) for stream in streams}
        """The local form of each action, by stream id."""
        self._clients: dict[int, ZenohClients] = {}
        self._servers: dict[int, ZenohServers] = {}
        for stream in streams:
            assert isinstance(stream.spec, ActionSpec)
            form, stream_id = self.forms[stream.stream_id], stream.stream_id
            if stream.spec.server == address:
                servers = self._servers[stream_id] = ZenohServers(
                    zenoh_session,
                    stream.name,
                    form,
                    priority=stream.qos.priority,
                    patience_s=PROGRAM_PATIENCE_S,
                    complain=input_errors.add,
                    hears_marked=False,
                )
                self._engine.serve(stream_id, Passage(partial(self._to_program, servers)))
            else:
                self._clients[stream_id] = ZenohClients(
                    form,
                    Passage(partial(self._to_channel, stream)),
                    put=dialects.put_about_goals(stream, form),
                    keep_s=stream.spec.result_timeout_s,
                    clock=clock,
                    mark=Marker(acoustic=stream.spec.server).encode(),
                    takes_marked=False,
                )

    def ask(self, stream_id: int, held: HeldQuery) -> None:
        """Take a query about goals for a remote server."""
        self._clients[stream_id].take(held)

    def ear(self, stream_id: int) -> Callable[[zenoh.Sample], None]:
        """Return a function that takes the local program's feedback, on Zenoh's thread."""
        return self._servers[stream_id].hear

    def close(self) -> None:
        """Stop asking the local network."""
        for servers in self._servers.values():
            servers.close()

    def _to_program(self, servers: ZenohServers, goal: TakenGoal) -> GivenGoal:
        assert isinstance(goal, EngineTakenGoal)
        assert goal.client is not None
        left_s = ns_to_seconds(goal.deadline_at - self._clock())
        mark = Marker(acoustic=goal.client).encode()
        return servers.give(goal.value, goal, limit_s=max(left_s, _LEAST_LIMIT_S), mark=mark)

    def _to_channel(self, stream: Stream, goal: TakenGoal) -> GivenGoal:
        assert isinstance(goal, ZenohTakenGoal)
        try:
            return self._engine.give(stream.stream_id, goal.value, goal, tag=goal.goal_id)
        except LocalError as error:
            self._input_errors.add(stream.name, "goal", str(error))
            raise

    def _recover(self, given: EngineGivenGoal) -> GoalClient | None:
        """Restore a local goal from before the restart."""
        if len(given.tag) != GOAL_ID_BYTES:
            return None
        goal = self._clients[given.key.stream_id].adopt(given.tag)
        goal.given = given
        return goal
