"""Engines of a fleet in virtual time, and the outcome of each publication and call.

A received sample is matched to the newest publication with the same payload that this node has not
received yet, which is exact as long as payloads differ.
"""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from zacoustic.app.tools.design.sim.sealing import sealed
from zacoustic.channel.scenario import Scenario
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import LocalError
from zacoustic.seal.spec import SecuritySpec
from zacoustic.testing.scenarios.checker import Arrived, Checker, Publication
from zacoustic.testing.virtual import VirtualNetwork


class FleetRun:
    """The engines of a fleet, whose servers answer at once.

    Args:
        scenario: The channel; its traffic is for the caller.
        tables: The table of each node.
        rules: Rules of transmission by address; a node without them transmits freely.
        checker: Sees each publication and its outcome.
        security: The seal of each node that has one.
        trace: Takes each trace record.
        digest: Compute the digest of the trace.
        build: Creates the engines; those that seal get a `cipher`.

    Raises:
        ConfigError: Frames are sealed, and the extra `secure` is not installed.
    """

    def __init__(
        self,
        scenario: Scenario,
        tables: Mapping[int, StreamTable],
        rules: Mapping[int, TransmitRules],
        checker: Checker,
        *,
        security: Mapping[int, SecuritySpec] = MappingProxyType({}),
        trace: Callable[[TraceRecord], None] | None = None,
        digest: bool = True,
        build: Callable[..., Engine] = Engine,
    ) -> None:
        self.table = next(iter(tables.values()))
        """The streams, as the first node has them."""
        self.answers: dict[int, object] = {}
        """Answer of each service, by stream id; others answer with no bytes."""
        self.refused: dict[int, int] = {}
        """Number of refused samples and calls, by stream id."""
        self.refusals: dict[int, LocalError] = {}
        """The last refusal, by stream id."""
        self._checker = checker
        self._number = 0
        self._published: dict[tuple[int, int, Instance, bytes], list[_Sent]] = {}
        self._called: dict[tuple[int, int, int], Publication] = {}
        first, *others = links_of(rules)
        self.network = VirtualNetwork(
            scenario,
            tables,
            link=first if others else None,
            deliver=self._deliver,
            trace=trace,
            digest=digest,
            lives=self._live,
            rules=rules,
            build=sealed(security, build),
        )
        for link in others:
            self.network.add_link(link, scenario.medium_of(link))
        for address in self.network.addresses:
            self._subscribe(address)

    def say(self, node: int, stream: Stream, instance: Instance, value: object) -> None:
        """Publish a sample, or call a service."""
        is_topic = isinstance(stream.spec, TopicSpec)

        def command(engine: Engine, now: int) -> None:
            if is_topic:
                result = engine.publish(stream.stream_id, value, now, instance=instance)
            else:
                result = engine.call(stream.stream_id, value, now)
            self._note(node, stream, instance, value, result, is_topic=is_topic)

        try:
            self.network.apply(node, command)
        except LocalError as error:
            self.refused[stream.stream_id] = self.refused.get(stream.stream_id, 0) + 1
            self.refusals[stream.stream_id] = error
            self._checker.refused(node, stream)

    def _note(
        self,
        node: int,
        stream: Stream,
        instance: Instance,
        value: object,
        result: int,
        *,
        is_topic: bool,
    ) -> None:
        self._number += 1
        life = self.network.life(node)
        publication = Publication(
            number=self._number,
            node=node,
            life=life,
            stream=stream,
            instance=instance,
            value=value,
            at=self.network.now,
            result=result,
            written=self.network.journal(node).handed_out + 1,
        )
        if is_topic:
            key = (stream.stream_id, node, instance, stream.codec.encode(value))
            self._published.setdefault(key, []).append(_Sent(publication))
            self._checker.published(publication)
        else:
            self._called[node, life, result] = publication
            self._checker.called(publication)

    def _deliver(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived):
            stream = self.table.by_id(event.stream_id)
            payload = stream.codec.encode(event.value)
            key = (event.stream_id, event.source, event.instance, payload)
            if known := self._published.get(key):
                lacking = (sent for sent in reversed(known) if address not in sent.got)
                sent = next(lacking, known[-1])
                sent.got.add(address)
                self._checker.received(self._arrived(sent.publication, address))
        elif isinstance(event, RequestReceived):
            answer = self.answers.get(event.call.stream_id)
            self.network.apply(
                address,
                lambda engine, at: engine.reply(event.call, b"" if answer is None else answer, at),
            )
        elif isinstance(event, ResponseReceived | CallFailed):
            call = (address, self.network.life(address), event.call_id)
            publication = self._called.pop(call, None)
            if publication is not None:
                arrived = self._arrived(publication, address)
                if isinstance(event, CallFailed):
                    self._checker.failed(arrived)
                else:
                    self._checker.answered(arrived)

    def _arrived(self, publication: Publication, node: int) -> Arrived:
        network = self.network
        return Arrived(publication=publication, node=node, life=network.life(node), at=network.now)

    def _live(self, address: int, is_alive: bool) -> None:
        if is_alive:
            self.network.at(self.network.now / NS_PER_S, partial(self._subscribe, address))
        else:
            self._checker.crashed(address, self.network.now)

    def _subscribe(self, address: int) -> None:
        """Subscribe to all on-demand topics."""
        if not self.network.is_running(address):
            return
        for stream in self.network.engine(address).table:
            if stream.is_on_demand and stream.may_subscribe(address):
                want = partial(_want, stream.stream_id)
                self.network.apply(address, want)


def links_of(rules: Mapping[int, TransmitRules]) -> list[str]:
    """Return the names of all links of a fleet, in the order of their nodes and files."""
    names = (link.name for each in rules.values() for link in each.of_links)
    return list(dict.fromkeys(names)) or [ONE_LINK]


def _want(stream_id: int, engine: Engine, now: int) -> None:
    engine.subscriptions.want(stream_id, now)


class _Sent:
    """A publication, and the nodes that have received it."""

    __slots__ = ("got", "publication")

    def __init__(self, publication: Publication) -> None:
        self.publication = publication
        self.got: set[int] = set()
