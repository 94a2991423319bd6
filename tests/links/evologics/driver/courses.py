"""What a seed decides about a voyage: who is where, on which port, and what goes wrong.

On a port without check damage inside of a received message cannot be told from another message, so
there it stays between them (`FaultPlan.spares_payloads`). With `check=true` it strikes anywhere.
"""

import random
from typing import Final

import msgspec

from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.streams.specs import ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import Behaviour, FaultKind, FaultPlan, ScriptedFault

FAULTS_S: Final = 60.0
"""How long things go wrong, s."""

EVERYBODY, FRESH, CALLS = 1, 2, 3
"""Streams: what all hear, what is urgent; each node has its own of the second and the third kind,
this number and its address in tens behind it."""
UNCHECKED_KINDS: Final = tuple(
    kind for kind in FaultKind if kind not in (FaultKind.CORRUPT, FaultKind.WRONG_LENGTH)
)
"""What may happen between the messages on a port without check."""


class Course(msgspec.Struct, frozen=True, kw_only=True):
    """What a seed decides about a voyage."""

    seed: int
    nodes: int
    spacing_m: float
    interpreter: Interpreter
    is_serial: bool
    config: EvologicsConfig
    acknowledge: float
    behaviour: Behaviour
    plan: FaultPlan


def course_of(seed: int, faults_s: float = FAULTS_S) -> Course:
    """Draw a course; things go wrong for so long, s."""
    rng = random.Random(f"voyage/{seed}")
    check, has_bursts = bool(seed % 2), rng.random() < 0.2
    nodes = 2 if has_bursts else rng.choice([2, 3])
    kinds = tuple(FaultKind) if check else UNCHECKED_KINDS
    rates = {kind: rng.choice([0.0, 0.0, 0.02, 0.1]) for kind in kinds}
    rates[FaultKind.RESET] = rng.choice([0.0, 0.005])
    rates[FaultKind.DROP_CONNECTION] = rng.choice([0.0, 0.005, 0.02])
    if rng.random() < 0.5:
        # A repetition behind other sounds looks like a message that was sent again.
        rates[FaultKind.LATE] = 0.0
    else:
        rates[FaultKind.DUPLICATE] = 0.0
    script = tuple(
        ScriptedFault(
            kind=rng.choice([FaultKind.BUSY, FaultKind.LOST_REPLY, FaultKind.GARBAGE]),
            at_s=rng.uniform(0.0, faults_s - 5.0),
            modem=rng.randint(0, nodes),
            lasts_s=rng.uniform(0.5, 5.0),
        )
        for _ in range(rng.randint(0, 4))
    )
    return Course(
        seed=seed,
        nodes=nodes,
        spacing_m=rng.uniform(20.0, 1500.0) / (nodes - 1),
        interpreter=rng.choice(list(Interpreter)),
        is_serial=rng.random() < 0.5,
        config=EvologicsConfig(
            check=check,
            mtu=200 if has_bursts else 64,
            extended_notifications=rng.random() < 0.85,
        ),
        acknowledge=rng.choice([0.0, 0.5, 1.0]),
        behaviour=Behaviour(
            second_im=rng.choice(["busy", "busy", "cancel"]),
            firmware=rng.choice(["1.6", "1.7", "1.8", "1.9"]),
        ),
        plan=FaultPlan(
            seed=seed,
            from_s=rng.choice([0.0, 15.0]),
            until_s=faults_s,
            rates=rates,
            spares_payloads=not check,
            script=script,
        ),
    )


def table_of(nodes: int) -> StreamTable:
    """Streams to everybody and to each, and a service of each."""
    urgent = Qos(priority=Priority.REAL_TIME)
    specs: list[StreamSpec] = [TopicSpec(stream_id=EVERYBODY, name="all", qos=Qos(depth=3))]
    for address in range(1, nodes + 1):
        specs += [
            TopicSpec(
                stream_id=10 * address + EVERYBODY,
                name=f"to{address}",
                subscribers=(address,),
                qos=Qos(depth=3),
            ),
            TopicSpec(
                stream_id=10 * address + FRESH,
                name=f"fresh{address}",
                subscribers=(address,),
                qos=urgent,
            ),
            ServiceSpec(
                stream_id=10 * address + CALLS, name=f"ask{address}", server=address, timeout_s=20
            ),
        ]
    return StreamTable(specs, nodes={each: f"n{each}" for each in range(1, nodes + 1)})
