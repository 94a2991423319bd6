"""Random scenarios of commands: two nodes give them, one executes, and everything goes wrong for a
while.

What the node does is looked at where it does it (`_Spy`), and compared with what was commanded,
with what it transmits and with what the others are told.
"""

import random
from functools import partial
from typing import Any, Final

import msgspec

from tests.virtual.fleet import line, settling_s
from tests.virtual.judged import JudgedScenario
from zacoustic.channel.profiles import profile_named
from zacoustic.channel.scenario import Scenario
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure, Event, ResponseReceived
from zacoustic.core.streams.commands import (
    COMMANDS_STREAM_ID,
    CommandKind,
    CommandState,
    RemoteCommand,
)
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.calls import CallKey
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import Modem, VirtualNetwork

VEHICLE: Final = 2
GIVERS: Final = (1, 3)
NAV: Final = 1
LOG: Final = 2
PROMPT_NS: Final = NS_PER_S // 10
_MOST_LOSS: Final = 0.6
_CALM_S: Final = 1300.0
_TIME_ERROR_S: Final = 3.0
_AGE_ERROR: Final = 0.03
_ALLOWED_REASONS: Final = ("overtaken by a later order", "it came when its time was over")


class Given(msgspec.Struct):
    """An order that was given."""

    giver: int
    life: int
    epoch: int
    serial: int
    command: RemoteCommand
    at: int
    is_calm: bool
    ends: list[tuple[int, Event]]
    """With the instants at which they came."""


class Executed(msgspec.Struct):
    """A command that the vehicle executed."""

    giver: int
    subject: int
    epoch: int
    serial: int
    at: int
    silent_until: int | None


class Hush(msgspec.Struct):
    """A time in which the vehicle has to be silent."""

    begun_at: int
    ends_at: int | None
    was_silent: bool
    """It was before: there is no last word."""
    words: int = 0
    """Frames after its beginning."""
    is_proved: bool = False
    """The same command has come again, with the epoch that the answer has told."""


class CommandScenario(JudgedScenario):
    """One random scenario.

    Args:
        seed: Everything follows from it.
    """

    def __init__(self, seed: int) -> None:
        self._rng = rng = random.Random(f"orders/{seed}")
        super().__init__(seed)
        self.given: dict[tuple[int, int, int], Given] = {}
        """By giver, its life and the call id."""
        self.executed: list[Executed] = []
        self.tried: list[tuple[int, int, int, int]] = []
        """``(giver, epoch, serial, instant)`` of those that were executed for a while, unproved."""
        self.crashes: list[int] = []
        self._serials: dict[tuple[int, int], int] = {}
        self._hush: Hush | None = None
        self._commit_s = rng.choice((0.0, 0.005, 0.05, 0.5))
        self._busy_s = rng.choice((600.0, 1800.0))
        self._late_s = rng.choice((0.0, 0.0, 900.0))
        """Beyond the settling time a frame may come again so much later, s."""
        self._again_s = 0.0
        """So much later any frame may come again, s; where the first one is lost, that is what its
        age lacks."""
        modem = Modem(acknowledges=rng.random() < 0.2)
        tables = {each: _table("a") for each in (*GIVERS, VEHICLE)}
        if rng.random() < 0.3:
            tables[GIVERS[1]] = _table("other")
        self.network = VirtualNetwork(
            self._weather(seed, modem),
            tables,
            modem=modem,
            deliver=self._take,
            trace=self._hear,
            digest=False,
            lives=self._live,
            build=self._build,
        )

    def run(self) -> list[str]:
        """Run it; returns what must not have happened."""
        rng, network = self._rng, self.network
        for giver in GIVERS:
            at_s = rng.uniform(0, 60)
            while at_s < self._busy_s:
                network.at(at_s, partial(self._give, giver))
                at_s += rng.expovariate(1 / 60)
        for stream_id, period_s in ((NAV, 15.0), (LOG, 90.0)):
            network.every(period_s, partial(self._publish, stream_id), first_s=rng.uniform(0, 20))
        calm_s = self._busy_s + _CALM_S
        resume = partial(self._give, GIVERS[0], RemoteCommand(kind=CommandKind.RESUME))
        network.at(calm_s, resume)
        network.at(calm_s + 650, partial(self._give, GIVERS[0], RemoteCommand(stream_id=NAV)))
        network.run(until_s=calm_s + 1300)
        self._judge()
        return self.violations

    # What the nodes do

    def _publish(self, stream_id: int) -> None:
        if self.network.is_running(VEHICLE):
            self.network.publish(VEHICLE, stream_id, b"sample")

    def _give(self, giver: int, command: RemoteCommand | None = None) -> None:
        network, is_calm = self.network, command is not None
        if not network.is_running(giver):
            return
        command = command or self._draw()
        timeout_s = 600.0 if is_calm else self._rng.choice((20.0, 60.0, 600.0))
        life = network.life(giver)

        def begin(engine: Engine, now: int) -> None:
            call_id = engine.commands.send(VEHICLE, command, now, timeout_s=timeout_s)
            serial = self._serials.get((giver, life), 0) + command.changes
            self._serials[giver, life] = serial
            self.given[giver, life, call_id] = Given(
                giver, life, engine.epoch, serial, command, network.now, is_calm, []
            )

        try:
            network.apply(giver, begin)
        except QueueFullError:
            self._serials[giver, life] = self._serials.get((giver, life), 0) + command.changes
            self._count("full")

    def _draw(self) -> RemoteCommand:
        rng = self._rng
        kind = rng.choice(
            (*CommandKind, CommandKind.SILENCE, CommandKind.SILENCE, CommandKind.RESUME)
        )
        if kind is CommandKind.SILENCE:
            for_s = rng.choice((None, *(round(rng.uniform(5, 400), 1) for _ in range(4))))
            return RemoteCommand(kind=kind, for_s=for_s)
        topic = rng.choice((NAV, LOG))
        if kind is CommandKind.OVERRIDE:
            return RemoteCommand(
                kind=kind,
                stream_id=topic,
                on=rng.choice((None, True, False)),
                min_interval_s=round(rng.uniform(0, 60), 2),
                priority=rng.choice((None, *Priority)),
            )
        if kind is CommandKind.RESET:
            return RemoteCommand(kind=kind, stream_id=topic)
        return RemoteCommand(kind=kind)

    def _build(self, **arguments: Any) -> Engine:
        engine = Engine(**arguments)
        if engine.address == VEHICLE:
            self._spy(engine)
        return engine

    def _spy(self, engine: Engine) -> None:
        """Look at what the vehicle does with orders."""
        ledger, silence = engine.commands._deduplication, engine.silence
        enter, begin, resume = ledger.enter, silence.begin, silence.resume
        unproved = engine.commands._unproved
        enter_unproved = unproved.enter

        def entered(giver: int, subject: int, epoch: int, serial: int, then: Any) -> None:
            until = None if self._hush is None else self._hush.ends_at
            self._executes(Executed(giver, subject, epoch, serial, self.network.now, until))
            enter(giver, subject, epoch, serial, then)

        def tried(call: CallKey, subject: int, serial: int, undo: Any, now: int) -> None:
            self.tried.append((call.client, call.epoch, serial, self.network.now))
            enter_unproved(call, subject, serial, undo, now)

        def begun(now: int, **options: Any) -> None:
            was_silent, before = silence.is_silent(now), self._hush
            begin(now, **options)
            at, until = self.network.now, silence.until(now)
            ends_at = None if until is None else at + until - now
            if was_silent and before is not None and not before.words:
                before.ends_at = ends_at  # the answer to the first order may still be on its way
            elif was_silent and before is not None and not before.is_proved:
                # The same command again, with the epoch that the answer has told: one more word.
                before.begun_at, before.ends_at = at, ends_at
                before.words, before.is_proved = 0, True
            else:
                self._hush = Hush(at, ends_at, was_silent)

        def resumed(now: int, **options: Any) -> None:
            self._hush = None
            resume(now, **options)

        for owner, name, spy in (
            (ledger, "enter", entered),
            (unproved, "enter", tried),
            (silence, "begin", begun),
            (silence, "resume", resumed),
        ):
            setattr(owner, name, spy)

    # What the engines say

    def _hear(self, record: TraceRecord) -> None:
        """Take notice of each transmission of the vehicle."""
        hush = self._hush
        if record.node != VEHICLE or record.what != "transmit" or hush is None:
            return
        now = self.network.now
        if hush.ends_at is not None and now >= hush.ends_at:
            return
        hush.words += 1
        if hush.was_silent or hush.words > 1:
            self._complain(f"node {VEHICLE} sends {record.frame} in a silence")
        elif COMMANDS_STREAM_ID not in record.streams:
            self._complain(f"the last word is {record.frame}")
        elif now - hush.begun_at > 16 * self._unit_ns + PROMPT_NS + 4 * self._commit_s * NS_PER_S:
            self._complain(f"the last word comes {(now - hush.begun_at) / NS_PER_S:.1f} s late")

    def _take(self, node: int, event: Event) -> None:
        if isinstance(event, CallFailed | ResponseReceived):
            given = self.given.get((node, self.network.life(node), event.call_id))
            if given is None:
                self._complain(f"{event} at node {node} ends no order")
                return
            given.ends.append((self.network.now, event))

    def _live(self, address: int, is_alive: bool) -> None:
        if address != VEHICLE:
            return
        if not is_alive:
            self.crashes.append(self.network.now)
            if self._hush is not None and not self._is_firm(self._hush.begun_at):
                self._hush = None  # it may have been forgotten
            if self._hush is not None:
                self._hush.was_silent = True  # no word is left

    # What must hold

    @property
    def _unit_ns(self) -> int:
        capabilities = self.network.capabilities(VEHICLE)
        return int(settling_s(capabilities) * NS_PER_S) // 4

    def _is_firm(self, at: int) -> bool:
        """Tell whether what was done then had been written down before the next crash."""
        settled_at = at + int((2 * self._commit_s + 0.001) * NS_PER_S)
        return not any(at <= crash <= settled_at for crash in self.crashes)

    def _executes(self, executed: Executed) -> None:
        """Compare a command that is executed with those before, about the same thing."""
        before = [
            each
            for each in self.executed
            if (each.giver, each.subject) == (executed.giver, executed.subject)
            and self._is_firm(each.at)
        ]
        self.executed.append(executed)
        epochs = [each.epoch for each in before]
        if executed.epoch in epochs and epochs[-1] != executed.epoch:
            self._complain(f"{executed} is of a former life")
        same = [each.serial for each in before if each.epoch == executed.epoch]
        if same and executed.serial <= max(same):
            self._complain(f"{executed} is executed behind {max(same)}")

    def _judge(self) -> None:
        for given in self.given.values():
            is_living = (
                self.network.is_running(given.giver)
                and self.network.life(given.giver) == given.life
            )
            if len(given.ends) > 1 or (is_living and not given.ends):
                self._complain(f"{given} has {len(given.ends)} ends")
            for at, event in given.ends:
                self._judge_end(given, at, event)
        for executed in self.executed:
            self._judge_executed(executed)
        vehicle = self.network.engine(VEHICLE)
        now = self.network.local_ns(VEHICLE)
        if vehicle.silence.is_silent(now):
            self._complain(f"node {VEHICLE} is silent for ever")

    def _judge_end(self, given: Given, at: int, event: Event) -> None:
        if isinstance(event, ResponseReceived):
            self._count("answered")
            state = CommandState.from_wire(event.value, event.age_s)
            if given.command.changes and not self._found(given, before=at):
                self._complain(f"{given} is answered and was not executed")
            if given.is_calm and state.silent:
                self._complain(f"{given} is answered by a silent node")
            if (state.on is None) != (given.command.stream_id is None):
                self._complain(f"{given} is answered by {state}")
            return
        assert isinstance(event, CallFailed)
        self._count(event.text if event.failure is CallFailure.HANDLER else event.failure.name)
        if given.is_calm:
            self._complain(f"{given} fails although all is calm: {event}")
        elif event.failure is CallFailure.HANDLER:
            if event.text not in _ALLOWED_REASONS:
                self._complain(f"{given} fails: {event.text}")
        elif event.failure is not CallFailure.TIMED_OUT:
            self._complain(f"{given} fails: {event}")

    def _judge_executed(self, executed: Executed) -> None:
        """Look whether it was given, and whether a silence is over when it was to be over."""
        given = next(
            (
                each
                for each in self.given.values()
                if (each.giver, each.epoch, each.serial)
                == (executed.giver, executed.epoch, executed.serial)
                and each.command.changes
            ),
            None,
        )
        if given is None:
            self._complain(f"{executed} was never commanded")
        elif given.at > executed.at:
            self._complain(f"{executed} is executed before it was commanded")
        elif given.command.for_s is not None and executed.silent_until is not None:
            wanted_s = given.at / NS_PER_S + given.command.for_s
            error_s = _TIME_ERROR_S + _AGE_ERROR * (executed.at - given.at) / NS_PER_S
            if executed.silent_until / NS_PER_S > wanted_s + error_s + self._again_s:
                self._complain(f"{executed} lasts beyond {wanted_s:.1f} s")
            if executed.silent_until / NS_PER_S < wanted_s - error_s:
                self._complain(f"{executed} ends before {wanted_s:.1f} s")

    def _found(self, given: Given, *, before: int) -> bool:
        return any(
            (each.giver, each.epoch, each.serial) == (given.giver, given.epoch, given.serial)
            and each.at <= before
            for each in self.executed
        ) or any(
            (giver, epoch, serial) == (given.giver, given.epoch, given.serial) and at <= before
            for giver, epoch, serial, at in self.tried
        )

    def _weather(self, seed: int, modem: Modem) -> Scenario:
        rng, busy_s = self._rng, self._busy_s
        positions = [rng.uniform(0, 2000) for _ in range(3)]
        bare = line(*positions)
        settled_s = settling_s(modem.capabilities(profile_named(bare.profile), bare.farthest_s))
        worst = rng.choice((0.0, 0.3, _MOST_LOSS))
        addresses = (*GIVERS, VEHICLE)
        links = [
            {
                "from": source,
                "to": target,
                "loss": {"frame": rng.uniform(0, worst), "until_s": busy_s},
            }
            for source in addresses
            for target in addresses
            if source != target
        ]
        most = rng.choice((0, 2, 10))
        crashes = [
            {
                "node": address,
                "at_s": sorted(rng.uniform(0, busy_s) for _ in range(rng.randint(0, most))),
                "restart_after_s": rng.choice((0.0, 1.0, 30.0)),
                "reboots": rng.random() < 0.5,
            }
            for address in addresses
        ]
        duplicate = rng.choice((0.0, 0.1, 0.5))
        after_s = self._late_s or 0.95 * settled_s
        self._again_s = after_s if duplicate else 0.0
        faults = {
            "duplicate": duplicate,
            "duplicate_after_s": [0.0, after_s],
            "jitter_s": rng.choice((0.0, 0.0, 0.05)),
            "crashes": [each for each in crashes if each["at_s"]],
            "journal": {"commit_s": self._commit_s, "untold": rng.choice((0.0, 0.5))},
            "until_s": busy_s,
        }
        return line(*positions, seed=seed, channel="none", links=links, faults=faults)


def _table(name: str) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=NAV, name=name, qos=Qos(depth=3), publishers=(VEHICLE,)),
            TopicSpec(
                stream_id=LOG,
                name="log",
                publishers=(VEHICLE,),
                subscribers=(GIVERS[0],),
                qos=Qos(reliability=Reliability.RELIABLE, depth=5),
            ),
        ],
        nodes={1: "shore", VEHICLE: "auv1", 3: "ship"},
    )
