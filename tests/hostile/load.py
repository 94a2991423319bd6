"""What the nodes of a fleet say: everything, at random, for a while."""

import contextlib
import random
from collections.abc import Callable
from typing import Any

from tests.hostile import fleet
from zacoustic.core.engine.engine import Engine
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError

Say = Callable[[Engine, int], object]
"""A command for an engine."""


def anything(rng: random.Random, address: int, table: StreamTable) -> Say:
    """Draw a command that a node may give its engine, whatever its table is."""
    stream = rng.choice(list(table))
    spec, stream_id = stream.spec, stream.stream_id
    ticket = rng.randrange(fleet.TICKETS)
    typed = bool(getattr(spec, "type_name", None))
    value: Any = fleet.value_of(
        fleet.NAV if typed else fleet.RAW, ticket, rng.choice((3, 10, 30, 400))
    )
    if isinstance(spec, TopicSpec):
        if stream.is_on_demand and rng.random() < 0.3:
            return lambda engine, now: engine.subscriptions.want(stream_id, now)
        instance: Instance = (rng.randrange(2),) if spec.wildcards else ()
        return lambda engine, now: engine.publish(stream_id, value, now, instance=instance)
    if isinstance(spec, ServiceSpec | ActionSpec):
        other = rng.choice([each for each in table.nodes if each != address])
        if rng.random() < 0.2:
            ask = RemoteCommand(kind=CommandKind.ASK)
            return lambda engine, now: engine.commands.send(other, ask, now, timeout_s=60.0)
    if isinstance(spec, ServiceSpec):
        return lambda engine, now: engine.call(stream_id, value[:20], now)
    return lambda engine, now: engine.actions.send_goal(stream_id, value[:20], now, timeout_s=200)


def said(engine: Engine, now: int, say: Say) -> None:
    """Give a command; what the engine refuses is refused."""
    with contextlib.suppress(LocalError):
        say(engine, now)
