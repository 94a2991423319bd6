"""Runs a random scenario: publishes, matches arrivals by their tickets, and calls the checkers."""

import contextlib
import itertools
import random
from collections.abc import Callable, Iterable

import msgspec

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import Stream
from zacoustic.errors import LocalError, PayloadTooLargeError
from zacoustic.testing.scenarios.checker import Arrived, Checker, Publication
from zacoustic.testing.scenarios.invariants import INVARIANTS
from zacoustic.testing.scenarios.randomscenario import Cast, Lane, RandomScenario, Shape
from zacoustic.testing.virtual import VirtualNetwork

_OFF_BEAT = 0.05
_MISUNDERSTOOD = (CallFailure.BAD_REQUEST, CallFailure.BAD_RESPONSE)


class RunResult(msgspec.Struct, frozen=True):
    """The result of a random scenario."""

    violations: tuple[str, ...]
    """Violated invariants, one line each."""
    digest: str
    """SHA-256 of the trace, if requested."""


def run_scenario(
    drawn: RandomScenario,
    checkers: Iterable[Callable[[], Checker]] = INVARIANTS,
    *,
    digest: bool = False,
    build: MakeEngine = Engine,
) -> RunResult:
    """Run a random scenario from its beginning to its end.

    Args:
        drawn: The scenario.
        checkers: Create the checkers.
        digest: Compute the digest of the trace as well.
        build: Creates the engines.
    """
    scenario_run = ScenarioRun(drawn, [make() for make in checkers], digest=digest, build=build)
    scenario_run.run()
    return RunResult(tuple(scenario_run.violations()), scenario_run.network.digest)


class ScenarioRun:
    """One run of a random scenario.

    Args:
        drawn: The scenario.
        checkers: The checkers.
        trace: Takes each trace record.
        digest: Compute the digest of the trace.
        build: Creates the engines.
    """

    def __init__(
        self,
        drawn: RandomScenario,
        checkers: Iterable[Checker] = (),
        *,
        trace: Callable[[TraceRecord], None] | None = None,
        digest: bool = False,
        build: MakeEngine = Engine,
    ) -> None:
        self.drawn = drawn
        self.checkers = tuple(checkers)
        self.misread: list[str] = []
        """Arrivals that nobody published in this form, one line each."""
        self._early: list[tuple[int, Event]] | None = []
        self.casts = dict(drawn.casts)
        """The cast of each node in its present boot epoch."""
        self._rng = random.Random(f"{drawn.seed}/telling")
        self._tickets: dict[int, Publication] = {}
        self._next = itertools.count(1)
        self._calls: dict[tuple[int, int, int], tuple[Publication, Lane]] = {}
        self.network = VirtualNetwork(
            drawn.scenario,
            {address: cast.table for address, cast in drawn.casts.items()},
            modem=drawn.modem,
            deliver=self._take,
            lives=self._live,
            trace=trace,
            digest=digest,
            build=build,
        )

    def run(self) -> None:
        """Run it, once."""
        try:
            self._run()
        except Exception as error:  # raised again
            error.add_note(f"again: zacoustic sim --random {self.drawn.seed}")
            raise

    def _run(self) -> None:
        for checker in self.checkers:
            checker.begins(self)
        early, self._early = self._early or [], None
        for address, event in early:
            self._take(address, event)
        streams = sorted(
            {
                stream_id
                for cast in (*self.drawn.casts.values(), *self.drawn.pool)
                for stream_id in cast.lanes
            }
        )
        for address in self.casts:
            for stream_id in streams:
                self._go_on(address, stream_id, 0.0)
        self.network.run(until_s=self.drawn.until_s)
        for checker in self.checkers:
            checker.ends(self)

    def violations(self) -> list[str]:
        """Return the violations that all checkers report."""
        return self.misread + [line for each in self.checkers for line in each.violations]

    @property
    def settling_ns(self) -> int:
        """Time within which a frame may come again, ns."""
        return max(settling_ns(self.network.capabilities(each)) for each in self.casts)

    # Actions of the nodes

    def _go_on(self, address: int, stream_id: int, now_s: float) -> None:
        """Act on a stream at a random instant or on the beat, repeatedly."""
        drawn = self.drawn
        longest_s = drawn.pause_s if now_s < drawn.busy_s else drawn.calm_pause_s
        if longest_s is None:
            return
        at_s = now_s + self._rng.uniform(longest_s / 30, longest_s)
        beat_s = drawn.beat_s if 0 < now_s < drawn.busy_s else None
        if beat_s is not None and self._rng.random() >= _OFF_BEAT:
            at_s = now_s + beat_s
        if at_s >= drawn.busy_s and drawn.calm_pause_s is None:
            return

        def act() -> None:
            if self.network.is_running(address):
                self._act(address, stream_id)
            self._go_on(address, stream_id, self.network.now / NS_PER_S)

        self.network.at(at_s, act)

    def _act(self, address: int, stream_id: int) -> None:
        """Publish or call, if the node's table has the stream."""
        cast = self.casts[address]
        lane = cast.lanes.get(stream_id)
        if lane is None:
            return
        stream = cast.table.by_id(stream_id)
        is_service = isinstance(lane.spec, ServiceSpec)
        if isinstance(lane.spec, ServiceSpec) and lane.spec.server == address:
            return
        if not is_service and not stream.may_publish(address):
            return
        wildcards = () if is_service else stream.keys.wildcards
        instance = tuple(self._rng.randrange(len(wildcard.values)) for wildcard in wildcards)
        number = next(self._next)
        value = lane.shape.write(number % lane.shape.tickets)

        def command(engine: Engine, now: int) -> None:
            # Noted before the engine acts: frames and writes that follow at once belong to it.
            if is_service:
                result = engine.call(stream_id, value, now)
            else:
                result = engine.publish(stream_id, value, now, instance=instance)
            self._note(lane, publish(result))

        def publish(result: int) -> Publication:
            return Publication(
                number=number,
                node=address,
                life=self.network.life(address),
                stream=stream,
                instance=instance,
                value=value,
                at=self.network.now,
                result=result,
                written=self.network.journal(address).handed_out + 1,
            )

        try:
            self.network.apply(address, command)
        except LocalError:
            for checker in self.checkers:
                checker.refused(address, stream)

    def _note(self, lane: Lane, publication: Publication) -> None:
        self._tickets[publication.number % lane.shape.tickets] = publication
        if isinstance(lane.spec, ServiceSpec):
            self._calls[publication.node, publication.life, publication.result] = publication, lane
            for checker in self.checkers:
                checker.called(publication)
        else:
            for checker in self.checkers:
                checker.published(publication)

    # Events of the engines

    def _live(self, address: int, is_alive: bool) -> None:
        if not is_alive:
            for checker in self.checkers:
                checker.crashed(address, self.network.now)
        elif self.drawn.pool:
            self.casts[address] = self._rng.choice(self.drawn.pool)
            self.network.set_table(address, self.casts[address].table)

    def _take(self, node: int, event: Event) -> None:
        if self._early is not None:  # the network is under construction
            self._early.append((node, event))
            return
        for checker in self.checkers:
            checker.happened(node, event, self.network.now)
        cast = self.casts[node]
        if isinstance(event, SampleReceived):
            stream = cast.table.by_id(event.stream_id)
            shape = cast.lanes[event.stream_id].shape
            found = self._find(node, stream, shape, event.source, event.instance, event)
            if found is not None:
                for checker in self.checkers:
                    checker.received(found)
        elif isinstance(event, RequestReceived):
            self._serve(node, cast, event)
        elif isinstance(event, ResponseReceived):
            self._be_answered(node, event)
        elif isinstance(event, CallFailed):
            call = self._calls.pop((node, self.network.life(node), event.call_id), None)
            if event.failure in _MISUNDERSTOOD:
                self._complain(node, f"a call was misunderstood: {event}")
            if call is not None:
                for checker in self.checkers:
                    checker.failed(self._arrived(call[0], node))

    def _find(
        self,
        node: int,
        stream: Stream,
        shape: Shape,
        source: int,
        instance: Instance,
        event: SampleReceived | RequestReceived,
    ) -> Arrived | None:
        """Return the publication of an arrival; None, and a violation, if there is none."""
        try:
            known = self._tickets.get(shape.read(event.value))
        except (KeyError, TypeError, ValueError) as error:
            self._complain(node, f"{event} cannot be read: {error!r}")
            return None
        if (
            known is None
            or known.node != source
            or known.value != event.value
            or known.stream.digest != stream.digest
            or known.key != stream.keys.key(source, instance)
        ):
            self._complain(node, f"{event} on {stream.name}; published: {known}")
            return None
        return self._arrived(known, node, again=isinstance(event, SampleReceived) and event.again)

    def _arrived(self, publication: Publication, node: int, *, again: bool = False) -> Arrived:
        return Arrived(
            publication=publication,
            node=node,
            life=self.network.life(node),
            at=self.network.now,
            again=again,
        )

    def _serve(self, node: int, cast: Cast, event: RequestReceived) -> None:
        """Answer with the ticket of the request after a short time."""
        lane = cast.lanes[event.call.stream_id]
        stream = cast.table.by_id(event.call.stream_id)
        found = self._find(node, stream, lane.shape, event.call.client, (), event)
        if found is None:
            return
        for checker in self.checkers:
            checker.served(found)
        response = lane.response
        assert response is not None
        value = response.write(found.publication.number % response.tickets)

        def answer() -> None:
            if self.network.is_running(node) and self.network.life(node) == found.life:
                # An answer that fits no frame becomes an error for the caller.
                with contextlib.suppress(PayloadTooLargeError):
                    self.network.apply(
                        node, lambda engine, now: engine.reply(event.call, value, now)
                    )

        after_s = self._rng.uniform(0, 10)
        self.network.at(self.network.now / NS_PER_S + after_s, answer)

    def _be_answered(self, node: int, event: ResponseReceived) -> None:
        call = self._calls.pop((node, self.network.life(node), event.call_id), None)
        if call is None:
            self._complain(node, f"answer to no call: {event}")
            return
        publication, lane = call
        assert lane.response is not None
        if lane.response.read(event.value) != publication.number % lane.response.tickets:
            self._complain(node, f"{event} answers {publication}")
            return
        for checker in self.checkers:
            checker.answered(self._arrived(publication, node))

    def _complain(self, node: int, what: str) -> None:
        self.misread.append(f"{self.network.now / NS_PER_S:.3f} s: node {node}: {what}")


def settling_ns(capabilities: LinkCapabilities) -> int:
    """Return the time within which a link may repeat a frame, ns: four of its longest frames."""
    airtime_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
    return 4 * (airtime_ns + round(capabilities.propagation_s * NS_PER_S))
