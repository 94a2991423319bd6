"""The contract of checkers, which see each publication of a run and its outcome.

`ScenarioRun` finds the publication of an arrival by its ticket, so a checker never looks into a
payload. All instants are those of the network, ns, whatever the clocks of the nodes show.
"""

from collections.abc import Mapping
from typing import Any, Protocol

import msgspec

from zacoustic.core.engine.events import Event
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream
from zacoustic.testing.scenarios.randomscenario import Cast, RandomScenario
from zacoustic.testing.virtual import VirtualNetwork


class Publication(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A sample or a request that an engine has accepted."""

    number: int
    """Number of the publication in the run, from 1."""
    node: int
    """The publishing node."""
    life: int
    """Boot epoch of that node, counted from 1."""
    stream: Stream
    """The stream, as that node's table has it."""
    instance: Instance
    """The key among those of the topic."""
    value: Any
    """The value."""
    at: int
    """When."""
    result: int
    """What `Engine.publish` or `Engine.call` returned: delivery id or call id."""
    written: int
    """Number of its first journal write, for `VirtualJournal.is_journalled`."""

    @property
    def key(self) -> str:
        """The key of the publication."""
        return self.stream.keys.key(self.node, self.instance)


class Arrived(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A sample, a request or a response that an engine has delivered."""

    publication: Publication
    """Its publication, or for a response that of its request."""
    node: int
    """The receiving node."""
    life: int
    """The receiver's boot epoch, counted from 1."""
    at: int
    """When."""
    again: bool = False
    """A boot epoch that was cut short may have delivered it before."""


class Run(Protocol):
    """A run in progress, as its checkers see it."""

    @property
    def drawn(self) -> RandomScenario:
        """The random scenario."""

    @property
    def network(self) -> VirtualNetwork:
        """The network with its nodes."""

    @property
    def casts(self) -> Mapping[int, Cast]:
        """The cast of each node in its present boot epoch."""

    @property
    def settling_ns(self) -> int:
        """Time within which a frame may come again, ns."""


class Checker:
    """Watches a run; a subclass overrides the methods that it needs and appends to `violations`."""

    def __init__(self) -> None:
        self.violations: list[str] = []
        """Violations, one line each."""

    def begins(self, scenario_run: Run) -> None:
        """The nodes exist, and nothing has happened yet."""

    def published(self, publication: Publication) -> None:
        """An engine has accepted a sample."""

    def called(self, publication: Publication) -> None:
        """An engine has accepted a call."""

    def refused(self, node: int, stream: Stream) -> None:
        """An engine has not accepted a sample or a call."""

    def received(self, arrived: Arrived) -> None:
        """A sample was delivered, equal to the published one."""

    def served(self, arrived: Arrived) -> None:
        """A request was delivered, equal to the sent one."""

    def answered(self, arrived: Arrived) -> None:
        """A caller got its answer, equal to the server's."""

    def failed(self, arrived: Arrived) -> None:
        """A caller got a failure."""

    def crashed(self, node: int, at: int) -> None:
        """A node has crashed; its journal is already as the next boot epoch finds it."""

    def happened(self, node: int, event: Event, at: int) -> None:
        """An engine has emitted any event; before the method for it."""

    def ends(self, scenario_run: Run) -> None:
        """The run is over."""
