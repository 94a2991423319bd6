"""Two mechanisms that have something for the same node at the same time, and each of them alone.

Node 1 knows node 2, 1000 m away. Within ten seconds it gives one mechanism its load, or two
mechanisms theirs; frames are lost on both ways. A run lasts until node 1, or for a subscription
node 2, has been told of the end of all that was given.
"""

import enum
import math
import random
from collections.abc import Callable, Collection
from functools import partial
from itertools import combinations
from typing import Final

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    Event,
    GoalReceived,
    GoalStatus,
    RequestReceived,
    ResponseReceived,
    ResultReceived,
    SubscribersChanged,
)
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID, CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

NEVER: Final = math.inf
LOSSES: Final = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Share of the frames that is lost; the seed chooses."""
_BEGIN_S: Final = 120.0
_GIVEN_WITHIN_S: Final = 10.0
_LONGEST_S: Final = 3600.0
_GIVER, _OTHER = 1, 2
_TALK, _SAMPLES, _OBJECT, _CALL, _GOAL, _VIEW = 1, 10, 11, 20, 30, 40


class Load(enum.Enum):
    """Which mechanism is given something."""

    SAMPLES = "reliable samples"
    CALLS = "calls"
    GOALS = "goals"
    COMMANDS = "commands"
    OBJECT = "object"
    SUBSCRIPTION = "subscription"


_ITEMS: Final = {
    Load.SAMPLES: 10,
    Load.CALLS: 5,
    Load.GOALS: 3,
    Load.COMMANDS: 3,
    Load.OBJECT: 1,
    Load.SUBSCRIPTION: 1,
}
"""How much is given to each."""
PAIRS: Final = tuple(combinations(Load, 2))


def loss_of(seed: int) -> float:
    """Return the share of the frames that is lost in the runs of a seed."""
    return LOSSES[seed % len(LOSSES)]


def finished_s(seed: int, loads: Collection[Load]) -> float:
    """Return how long it takes until all that was given has ended well, s; or `NEVER`.

    Args:
        seed: Everything follows from it: also the loss.
        loads: What is given.
    """
    left = {load: _ITEMS[load] for load in loads}

    def deliver(address: int, event: Event) -> None:
        if isinstance(event, RequestReceived | GoalReceived):
            at_s = network.now / NS_PER_S
            network.at(at_s, partial(network.apply, address, partial(_answer, event)))
        load = _ended(address, event)
        if load in left:
            left[load] -= 1

    scenario = scenario_from_mapping(
        {
            "nodes": [
                {"address": _GIVER, "position": [0, 0, 10]},
                {"address": _OTHER, "position": [1000, 0, 10]},
            ],
            "seed": seed,
            "channel": "none",
            "loss": {"frame": loss_of(seed)},
        },
        source="test",
    )
    network = VirtualNetwork(scenario, _table(), digest=False, deliver=deliver)
    for turn in range(3):  # they get to know each other
        for node in (_GIVER, _OTHER):
            network.at(turn * 30 + 10 * node, partial(network.publish, node, _TALK, b""))
    for load in loads:
        rng = random.Random(f"{seed}/{load.value}")  # given alike, whatever else is
        for _ in range(_ITEMS[load]):
            at_s = _BEGIN_S + rng.uniform(0, _GIVEN_WITHIN_S)
            network.at(at_s, partial(_give, network, load))
    until_s = _BEGIN_S + _GIVEN_WITHIN_S
    while until_s < _BEGIN_S + _LONGEST_S:
        network.run(until_s=until_s)
        if not any(left.values()):
            return until_s - _BEGIN_S
        until_s += 1
    return NEVER


def _give(network: VirtualNetwork, load: Load) -> None:
    commands: dict[Load, Callable[[Engine, int], object]] = {
        Load.CALLS: lambda engine, now: engine.call(_CALL, b"call", now),
        Load.GOALS: lambda engine, now: engine.actions.send_goal(_GOAL, b"goal", now),
        Load.COMMANDS: lambda engine, now: engine.commands.send(
            _OTHER, RemoteCommand(kind=CommandKind.ASK), now
        ),
        Load.SUBSCRIPTION: lambda engine, now: engine.subscriptions.want(_VIEW, now),
    }
    if load in commands:
        network.apply(_GIVER, commands[load])
    elif load is Load.OBJECT:
        network.publish(_GIVER, _OBJECT, random.Random(1).randbytes(2000))
    else:
        network.publish(_GIVER, _SAMPLES, b"sample of 20 bytes..")


def _answer(event: RequestReceived | GoalReceived, engine: Engine, now: int) -> None:
    if isinstance(event, RequestReceived):
        engine.reply(event.call, b"response", now)
    else:
        engine.actions.accept(event.goal, now)
        engine.actions.finish(event.goal, GoalStatus.SUCCEEDED, b"result", now)


def _ended(address: int, event: Event) -> Load | None:
    match event:
        case DeliveryEnded(outcome=DeliveryOutcome.DELIVERED, stream_id=stream_id):
            return Load.OBJECT if stream_id == _OBJECT else Load.SAMPLES
        case ResponseReceived(stream_id=stream_id):
            return Load.COMMANDS if stream_id == COMMANDS_STREAM_ID else Load.CALLS
        case ResultReceived():
            return Load.GOALS
        case SubscribersChanged() if address == _OTHER and event.subscribers:
            return Load.SUBSCRIPTION
    return None


def _table() -> StreamTable:
    reliable = Qos(reliability=Reliability.RELIABLE, depth=20)
    bulk = Qos(reliability=Reliability.RELIABLE, depth=4, priority=Priority.BACKGROUND)

    def topic(stream_id: int, name: str, qos: Qos) -> TopicSpec:
        return TopicSpec(
            stream_id=stream_id, name=name, qos=qos, publishers=(_GIVER,), subscribers=(_OTHER,)
        )

    return StreamTable(
        [
            TopicSpec(stream_id=_TALK, name="{node}/talk"),
            topic(_SAMPLES, "samples", reliable),
            topic(_OBJECT, "object", bulk),
            ServiceSpec(stream_id=_CALL, name="call", server=_OTHER, timeout_s=_LONGEST_S),
            ActionSpec(
                stream_id=_GOAL,
                name="goal",
                server=_OTHER,
                timeout_s=_LONGEST_S,
                result_timeout_s=_LONGEST_S,
            ),
            TopicSpec(
                stream_id=_VIEW,
                name="view",
                qos=Qos(forward=Forward.ON_DEMAND),
                publishers=(_OTHER,),
            ),
        ],
        nodes={_GIVER: "giver", _OTHER: "other"},
    )
