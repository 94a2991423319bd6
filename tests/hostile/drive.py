"""`Drive`: runs one scenario in virtual time, plays the applications, and tells the oracle."""

import contextlib
import functools
import gc
import itertools
import random
import types
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

from tests.hostile import fleet, foreign
from tests.hostile.oracle import FLOODED_S, Given, Oracle
from tests.hostile.scenario import LONGEST_REST_S, Hostile
from tests.virtual.sealed import SealedFleet
from tests.virtual.twolinks import RADIO, RADIO_MODEM, SOUND
from zacoustic.core.base.journal import EPOCH_KEY
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryEnded,
    Event,
    GoalStatus,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
    SilenceChanged,
)
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.transport.actions.events import (
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    ResultReceived,
)
from zacoustic.errors import LocalError
from zacoustic.testing.virtual import VirtualNetwork

MOST_OBJECTS: Final = 100_000
"""Objects by which all engines together, and the lists that their dense coding shares, may have
grown when nothing is to be done any more; those lists are half of it."""
_OBJECTS_EACH: Final = 12
"""The objects by which drive and oracle remember what was given, each."""
MOST_ENTRIES: Final = 400
"""Entries in the journal of a node that has nothing to do."""
MOST_LATE: Final = 10
"""Frames in the second half of the calm: introductions of nodes that are polled."""
SILENCE_S: Final = 150.0
_COMMANDED_S: Final = 20.0
_SILENT: Final = 2
_LAST_WORD_S: Final = 30.0
_STRANGERS: Final = range(50, 250)


TURN_BYTES: Final = 12
"""Size of a frame that only gives or ends a turn, with the longest head of a seal."""


class Drive:
    """One run.

    Args:
        hostile: The scenario.
    """

    def __init__(self, hostile: Hostile) -> None:
        self.hostile = hostile
        self.longest_s = 0.0
        """Time from the last command to the last frame, s."""
        self.frames = 0
        """All frames that were sent."""
        self._rng = random.Random(f"drive {hostile.seed}")
        self._tickets = itertools.count(1)
        self._written: dict[int, int] = {}
        self._copies: dict[int, dict[str, bytes]] = {}
        self._silent_from: float | None = None
        self._sent: Counter[int] = Counter()
        self._last_frame_s = 0.0
        self._late_frames = 0
        faults = hostile.scenario.faults
        is_foreign = hostile.kind == "foreign"
        setting = hostile.setting
        self.ends = setting.ends or hostile.addresses
        of_nodes = setting.rules.values() if isinstance(setting.rules, dict) else [setting.rules]
        lifetimes_s = [route.longest_s for rules in of_nodes for route in rules.routes]
        lifetimes_s += [rules.flood.hops * FLOODED_S for rules in of_nodes if rules.flood]
        self.oracle = Oracle(
            self.ends,
            doubles=bool(faults.duplicate) or is_foreign,
            strangers=is_foreign,
            lifetime_s=max(lifetimes_s, default=0.0),
        )
        self._early: list[tuple[int, Event]] | None = []
        top = max(hostile.addresses) + 1
        self.network = VirtualNetwork(
            hostile.scenario,
            setting.table or fleet.table(range(1, top)),
            modem=hostile.modem,
            mtu_bytes=setting.mtu_bytes,
            deliver=self._take,
            trace=self._note,
            digest=False,
            link=SOUND if setting.beside is not None else None,
            rules=setting.rules,
            disturb=setting.disturb(),
            build=self._build(),
            point=self._point,
        )
        if setting.beside is not None:
            self.network.add_link(
                RADIO, setting.beside, modem=RADIO_MODEM, disturb=setting.disturb_beside()
            )
        self._objects = _objects_of(self.network.engine(fleet.SERVER))

    def _build(self) -> MakeEngine:
        setting = self.hostile.setting
        make = functools.partial(Engine, sizes=setting.sizes)
        return SealedFleet(make=make) if setting.is_sealed else make

    def _point(self, node: int, what: str, event: Event | None) -> None:
        """Do nothing before and after commits and events; subclasses crash nodes there."""

    def run(self) -> list[str]:
        """Run it; returns what must not have happened."""
        hostile, network, rng = self.hostile, self.network, self._rng
        early, self._early = self._early or [], None
        for node, event in early:
            self._take(node, event)
        for at_s, node in self._instants():
            network.at(at_s, functools.partial(self._command, node, rng.getrandbits(32)))
        for at_s, node, reboots in hostile.restarts:
            network.at(at_s / 2, functools.partial(self._copy, node))
            network.at(at_s, functools.partial(self._kill, node, reboots))
            pause_s = rng.choice((0.0, 5.0, LONGEST_REST_S))
            network.at(at_s + pause_s, functools.partial(network.start, node))
        if hostile.kind in ("foreign", "forged"):
            self._let_strangers_speak()
        if (babbler := hostile.setting.babbler) is not None:
            for number in range(int(2 * hostile.busy_s)):
                network.at(number / 2, functools.partial(self._babble, babbler))
        if hostile.kind == "silent":
            network.at(
                _COMMANDED_S,
                functools.partial(
                    self._order, 1, RemoteCommand(kind=CommandKind.SILENCE, for_s=SILENCE_S)
                ),
            )
            network.at(
                hostile.busy_s + SILENCE_S + 300,
                functools.partial(self._order, 1, RemoteCommand(kind=CommandKind.RESUME)),
            )
        try:
            network.run(until_s=hostile.busy_s + hostile.setting.calm_s)
        except Exception as error:
            error.add_note(f"again: python -m tests.hostile {hostile.seed}")
            raise
        self._check_rest()
        self.oracle.check_ends()
        self.longest_s = max(0.0, self._last_frame_s - hostile.busy_s)
        return self.oracle.violations

    # What the applications do

    def _instants(self) -> list[tuple[float, int]]:
        hostile, rng = self.hostile, self._rng
        found: list[tuple[float, int]] = []
        for node in self.ends:
            at_s = rng.uniform(0, hostile.pause_s)
            while at_s < hostile.busy_s:
                found.append((at_s, node))
                at_s += rng.expovariate(1 / hostile.pause_s)
            if hostile.together:
                found += [(10.0 * beat, node) for beat in range(1, 4)]
        return sorted(found)

    def _command(self, node: int, seed: int) -> None:
        if not self.network.is_running(node):
            return
        rng, sizes = random.Random(seed), self.hostile.sizes
        streams = [*fleet.BEST_EFFORT, *fleet.RELIABLE * 2, fleet.VIEW, fleet.DIARY]
        if node != fleet.SERVER:
            streams += [fleet.ARM, fleet.ARM, fleet.GOTO, 175]
        known = self.network.engine(node).table
        stream_id = rng.choice([each for each in streams if known.get(each) is not None])
        if stream_id in fleet.ON_DEMAND and rng.random() < 0.5:
            self._apply(node, lambda engine, now: engine.subscriptions.want(stream_id, now))
            return
        ticket = next(self._tickets)
        is_large = stream_id in fleet.RELIABLE and rng.random() < 0.3
        size = rng.choice(sizes) if is_large else rng.choice(sizes[:2])
        value = fleet.value_of(stream_id, ticket, size)
        instance = (rng.randrange(2),) if stream_id in fleet.WITH_PARTS else ()
        if stream_id == 175:
            other = rng.choice([each for each in self.ends if each != node])
            self._order(node, RemoteCommand(kind=CommandKind.ASK), to=other)
        elif stream_id == fleet.ARM:
            self._give(
                node,
                "call",
                ticket,
                stream_id,
                value,
                (),
                lambda engine, now: engine.call(stream_id, value, now),
            )
        elif stream_id == fleet.GOTO:
            self._give(
                node, "goal", ticket, stream_id, value, (),
                lambda engine, now: engine.actions.send_goal(stream_id, value, now, timeout_s=200),
            )  # fmt: skip
        else:
            self._give(
                node, "sample", ticket, stream_id, value, instance,
                lambda engine, now: engine.publish(stream_id, value, now, instance=instance),
            )  # fmt: skip

    def _give(
        self, node: int, kind: str, ticket: int, stream_id: int, value: Any,
        instance: tuple[int, ...], command: Callable[[Engine, int], object],
    ) -> None:  # fmt: skip
        network = self.network
        self._written[ticket] = network.journal(node).handed_out + 1

        def give(engine: Engine, now: int) -> None:
            given = Given(
                node, network.life(node), stream_id, instance, value, network.now / NS_PER_S,
                command(engine, now),
            )  # fmt: skip
            self.oracle.give(ticket, kind, given)

        self._apply(node, give)

    def _order(self, node: int, command: RemoteCommand, *, to: int = _SILENT) -> None:
        if self.network.is_running(node):
            ticket = next(self._tickets)
            self._give(
                node, "call", ticket, 175, None, (),
                lambda engine, now: engine.commands.send(to, command, now, timeout_s=300.0),
            )  # fmt: skip

    def _babble(self, node: int) -> None:
        if self.network.is_running(node):
            value = fleet.value_of(fleet.RAW, next(self._tickets), 20)
            self._give(
                node, "sample", fleet.ticket_of(value) or 0, fleet.RAW, value, (),
                lambda engine, now: engine.publish(fleet.RAW, value, now),
            )  # fmt: skip

    def _apply(self, node: int, command: Callable[[Engine, int], object]) -> None:
        with contextlib.suppress(LocalError):  # refused, and the application knows
            self.network.apply(node, command)

    # What goes wrong

    def _copy(self, node: int) -> None:
        self._copies[node] = dict(self.network.journal(node).entries)

    def _kill(self, node: int, reboots: bool) -> None:
        network, kind = self.network, self.hostile.kind
        if not network.is_running(node):
            return
        life, journal = network.life(node), network.journal(node)
        network.crash(node, reboots=reboots)
        kept = {
            ticket: given.stream_id not in (fleet.ARM, fleet.LIGHT, 175)
            and journal.is_journalled(self._written[ticket])
            for ticket, given in self.oracle.given.items()
            if given.node == node
        }
        self.oracle.killed(node, life, kept, now_s=self.network.now / NS_PER_S)
        if kind == "restored":
            epoch = journal.entries.get(EPOCH_KEY)
            journal.put_back(self._copies.get(node, {}))  # unnoticed, as an image of the disk
            if EPOCH_KEY not in journal.entries and epoch is not None:
                journal.entries[EPOCH_KEY] = epoch
            self._forget(node)
        elif kind == "damaged":
            share = self._rng.choice((0.1, 0.5, 1.0))
            journal.entries = {
                key: entry
                for key, entry in journal.entries.items()
                if key == EPOCH_KEY or self._rng.random() > share
            }
            self._forget(node)

    def _forget(self, node: int) -> None:
        self.oracle.forgetful.add(node)
        for given in self.oracle.given.values():
            given.is_forgotten |= given.node == node

    def _let_strangers_speak(self) -> None:
        hostile, network, rng = self.hostile, self.network, self._rng
        is_forged = hostile.kind == "forged"
        pool = (
            foreign.subscribe_requests(hostile.modem)
            if is_forged
            else foreign.frames(rng.randrange(1, foreign.VARIANTS + 1), hostile.modem)
        )
        place, at_s = rng.randrange(len(pool)), 0.0
        while at_s < hostile.busy_s:
            at_s += rng.choice((0.1, 0.5, 2.0))
            place = rng.randrange(len(pool)) if rng.random() < 0.05 else place + 1
            frame = pool[place % len(pool)]
            node = (
                frame.destination
                if frame.destination in hostile.addresses
                else rng.choice(hostile.addresses)
            )
            if is_forged:
                node = fleet.SERVER
                frame = foreign.Stranger(rng.choice(_STRANGERS), node, frame.frame_bytes)
            elif rng.random() < 0.1 and not hostile.modem.addressed:
                frame = foreign.mutated(rng, frame)  # the check of ours finds it
            network.at(at_s, functools.partial(self._hear, node, frame))

    def _hear(self, node: int, frame: foreign.Stranger) -> None:
        if self.network.is_running(node):
            addressed = self.hostile.modem.addressed
            self.network.apply(
                node,
                lambda engine, now: engine.handle_frame(
                    frame.received(now, addressed=addressed), now
                ),
            )

    # What the engines tell

    def _note(self, record: TraceRecord) -> None:
        if record.what != "transmit":
            return
        self.frames += 1
        self._sent[record.node] += record.link in (ONE_LINK, SOUND, RADIO)
        now_s = record.at / NS_PER_S
        if not (self.hostile.setting.is_polled and record.size_bytes <= TURN_BYTES):
            self._last_frame_s = now_s
            self._late_frames += now_s > self.hostile.busy_s + self.hostile.setting.calm_s / 2
        mtu_bytes = self.hostile.modem.mtu_bytes or 64
        if record.link != RADIO and record.size_bytes > mtu_bytes:
            self.oracle.complain(f"a frame of {record.size_bytes} bytes; MTU: {mtu_bytes}")
        since = self._silent_from
        if record.node != _SILENT or since is None:
            return
        if since + _LAST_WORD_S < now_s < _COMMANDED_S + 0.95 * SILENCE_S:
            self.oracle.complain(
                f"{now_s:.1f} s: node {_SILENT} transmits; it was silenced at {since:.1f} s for "
                f"{SILENCE_S:g} s"
            )
            self._silent_from = None

    def _take(self, node: int, event: Event) -> None:
        if self._early is not None:  # the network is being made
            self._early.append((node, event))
            return
        oracle, life = self.oracle, self.network.life(node)
        now_s = self.network.now / NS_PER_S
        match event:
            case SampleReceived():
                oracle.hand_on(
                    node, life, event.source, event.stream_id, event.instance, event.value,
                    now_s=now_s, again=event.again,
                )  # fmt: skip
            case RequestReceived() if event.call.client in self.hostile.addresses:
                oracle.hand_on(node, life, event.call.client, event.call.stream_id, (), event.value)
                self._later(
                    node,
                    5.0,
                    lambda engine, now: engine.reply(event.call, event.value + b"ok", now),
                )
            case GoalReceived():
                if event.goal.client in self.hostile.addresses:
                    oracle.hand_on(node, life, event.goal.client, fleet.GOTO, (), event.value)
                self._pursue(node, event)
            case DeliveryEnded():
                oracle.end(node, life, "sample", event.delivery_id, event.outcome.value, now_s)
            case ResponseReceived():
                oracle.end(node, life, "call", event.call_id, "answered", now_s)
            case CallFailed():
                oracle.end(node, life, "call", event.call_id, event.failure.name.lower(), now_s)
            case GoalAnswered(accepted=False) | GoalFailed():
                oracle.end(node, life, "goal", event.goal, "failed", now_s)
            case ResultReceived():
                oracle.end(node, life, "goal", event.goal, "ended", now_s)
            case SilenceChanged(is_silent=True, is_commanded=True) if node == _SILENT:
                if self._silent_from is None:
                    self._silent_from = self.network.now / NS_PER_S
            case _:
                pass

    def _pursue(self, node: int, event: GoalReceived) -> None:
        goal = event.goal
        if self._rng.random() < 0.2:
            self._later(node, 0.0, lambda engine, now: engine.actions.reject(goal, now, text="no"))
            return
        self._later(node, 0.0, lambda engine, now: engine.actions.accept(goal, now))
        self._later(
            node, 9.0, lambda engine, now: engine.actions.publish_feedback(goal, b"half", now)
        )
        self._later(
            node, 20.0,
            lambda engine, now: engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"done", now),
        )  # fmt: skip

    def _later(self, node: int, most_s: float, command: Callable[[Engine, int], object]) -> None:
        life = self.network.life(node)

        def act() -> None:
            if self.network.is_running(node) and self.network.life(node) == life:
                self._apply(node, command)

        self.network.at(self.network.now / NS_PER_S + self._rng.uniform(0, most_s), act)

    # The end

    def _check_rest(self) -> None:
        """All is calm: nobody has anything to do, or remembers more than it has to."""
        setting = self.hostile.setting
        self._check_sums()
        last_s = self._last_frame_s - self.hostile.busy_s
        if self._late_frames > MOST_LATE or not (setting.is_polled or self.network.is_quiet):
            self.oracle.complain(f"it never ends: the last frame was {last_s:.0f} s into the calm")
        for node in self.hostile.addresses:
            engine = self.network.engine(node)
            if not (setting.is_polled or engine.is_idle):
                waits = engine.poll_timeout()
                self.oracle.complain(f"node {node} is not idle at the end; it waits for {waits}")
            entries = len(self.network.journal(node).entries)
            if entries > MOST_ENTRIES:
                self.oracle.complain(f"node {node} keeps {entries} entries in its journal")
        grown_by = _objects_of(self.network.engine(fleet.SERVER)) - self._objects
        if grown_by > MOST_OBJECTS + _OBJECTS_EACH * len(self.oracle.given):
            self.oracle.complain(f"the engines have grown by {grown_by} objects")

    def _check_sums(self) -> None:
        """Compare what the counters say with each other, and with what was on the water."""
        for node in self.hostile.addresses:
            all_stats = [*self.network.stats_of(node)]
            counted = sum(each.frames_transmitted for each in all_stats)
            if counted != self._sent[node]:
                self.oracle.complain(
                    f"node {node} counts {counted} frames; {self._sent[node]} were transmitted"
                )
            in_all = sum(each.bytes_transmitted for each in all_stats)
            entries = [entry for each in all_stats for entry in each.ledger()]
            in_ledger = sum(each.transmitted_bytes for each in entries)
            if in_all != in_ledger:
                self.oracle.complain(
                    f"node {node}: {in_all} bytes in all, {in_ledger} in its ledger"
                )


def _objects_of(engine: Engine) -> int:
    """Count what an engine refers to, and by its trace all others; code and modules excepted."""
    return len(_reach(engine, set()))


def _reach(root: object, seen: set[int]) -> set[int]:
    skipped = (
        type,
        types.ModuleType,
        types.FunctionType,
        types.CodeType,
        types.BuiltinFunctionType,
    )
    waiting: list[object] = [root]
    while waiting and len(seen) <= 1_000_000:
        each = waiting.pop()
        if id(each) in seen or isinstance(each, skipped):
            continue
        seen.add(id(each))
        waiting += gc.get_referents(each)
    return seen
