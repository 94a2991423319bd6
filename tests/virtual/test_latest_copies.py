"""At most once has one limit: nothing is done twice while copies come within five units.

A copy of each frame comes at a random instant up to that limit, and both ends restart again and
again, the client most: its calls and goals of another boot epoch have the same numbers.
"""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Final

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, GoalReceived, GoalStatus, RequestReceived
from zacoustic.core.peers.handshake import LATEST_UNITS, unit_ns
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import VirtualNetwork

CLIENT, SERVER = 1, 2
ARM, MOVE = 20, 40
MEAN_S: Final = 20.0
UNTIL_S: Final = 1800.0
COPIED: Final = 0.5


class Copying:
    """A client and a server on a channel that copies frames as late as the page allows.

    Args:
        seed: Everything follows from it.
        loss: Share of the frames that are lost.
        latest: How late copies come, in parts of the limit.
    """

    def __init__(self, seed: int, *, loss: float = 0.1, latest: float = 1.0) -> None:
        self.done: Counter[tuple[int, bytes]] = Counter()
        """How often the server has begun each request and goal."""
        self._rng = random.Random(f"copies {seed}")
        self._loss = loss
        self._latest_ns: int | None = None
        mapping = {
            "channel": "none",
            "seed": seed,
            "nodes": [{"address": each, "position": [500 * each, 0, 10]} for each in (1, 2)],
        }
        self._table = StreamTable(
            [
                ServiceSpec(stream_id=ARM, name="arm", server=SERVER, timeout_s=60.0),
                ActionSpec(stream_id=MOVE, name="move", server=SERVER, timeout_s=60.0),
            ],
            nodes={1: "shore", 2: "auv"},
        )
        self.network = VirtualNetwork(
            scenario_from_mapping(mapping, source="a test"),
            self._table,
            disturb=self._disturb,
            deliver=self._happened,
            digest=False,
        )
        capabilities = self.network.engine(CLIENT).capabilities
        assert capabilities is not None
        # What comes at all has been under way for the shortest airtime and the sound's way.
        shortest_ns = capabilities.airtime_ns(1) + NS_PER_S // 3
        self._latest_ns = round(latest * (LATEST_UNITS * unit_ns(capabilities) - shortest_ns))
        self._plan()

    def _plan(self) -> None:
        at_s, number = 30.0, 0
        while at_s < UNTIL_S:
            act = self._rng.choice((self._call, self._call, self._send, self._send, self._restart))
            self.network.at(at_s, partial(act, b"%d" % number))
            at_s, number = at_s + self._rng.uniform(0, 2 * MEAN_S), number + 1

    def _disturb(self, source: int, node: int, now: int) -> tuple[float, ...]:
        arrivals = () if self._rng.random() < self._loss else (0.0,)
        if self._latest_ns is None or self._rng.random() > COPIED:
            return arrivals
        return (*arrivals, self._rng.random() ** 0.5 * self._latest_ns / NS_PER_S)

    def _call(self, tag: bytes) -> None:
        self._try(CLIENT, lambda engine, now: engine.call(ARM, tag, now))

    def _send(self, tag: bytes) -> None:
        self._try(CLIENT, lambda engine, now: engine.actions.send_goal(MOVE, tag, now))

    def _restart(self, tag: bytes) -> None:
        node = CLIENT if self._rng.random() < 0.8 else SERVER
        self.network.crash(node)
        self._later(self._rng.uniform(0.0, 20.0), partial(self.network.start, node))

    def _try(self, node: int, command: Callable[[Engine, int], object]) -> None:
        if self.network.is_running(node):
            try:
                self.network.apply(node, command)
            except QueueFullError:
                return

    def _later(self, pause_s: float, action: Callable[[], object]) -> None:
        self.network.at(self.network.now / NS_PER_S + pause_s, action)

    def _happened(self, node: int, event: Event) -> None:
        match event:
            case RequestReceived(call=call, value=bytes(value)):
                self.done[ARM, value] += 1
                answer = partial(
                    self._try, node, lambda engine, now: engine.reply(call, value, now)
                )
                self._later(self._rng.uniform(0.0, 8.0), answer)
            case GoalReceived(goal=goal, value=bytes(value)):
                self.done[MOVE, value] += 1

                def finish(engine: Engine, now: int) -> None:
                    engine.actions.accept(goal, now)
                    engine.actions.finish(goal, GoalStatus.SUCCEEDED, value, now)

                self._later(self._rng.uniform(0.0, 8.0), partial(self._try, node, finish))
            case _:
                pass


def test_nothing_is_done_twice_while_copies_come_in_time(count: Callable[[int], int]) -> None:
    done = 0
    for seed in range(count(600)):
        copying = Copying(seed)
        copying.network.run(until_s=UNTIL_S + 120.0)
        done += len(copying.done)
        twice = {name: times for name, times in copying.done.items() if times > 1}
        assert not twice, f"seed {seed}: {twice}"
    assert done > 40 * count(600)
