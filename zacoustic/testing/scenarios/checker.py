"""The checker of a run: gets each publication with its outcome.

`ScenarioRun` knows the publication of an arrival by its ticket, so a checker never looks into a
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
    """Counts all publications of the run, from 1."""
    node: int
    """Who published it."""
    life: int
    """Boot epoch of that node, counted from 1."""
    stream: Stream
    """The stream, as that node's table has it."""
    instance: Instance
    """Which of the topic's keys."""
    value: Any
    """The value."""
    at: int
    """When."""
    result: int
    """What `Engine.publish` or `Engine.call` returned: delivery id or call id."""
    written: int
    """Number of its first journal write: `VirtualJournal.is_journalled` tells whether it is
    safe."""

    @property
    def key(self) -> str:
        """The key expression that it was published under."""
        return self.stream.keys.key(self.node, self.instance)


class Arrived(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A sample, a request or a response that an engine has handed over."""

    publication: Publication
    """What it is, or what it answers."""
    node: int
    """Who has got it."""
    life: int
    """The receiver's boot epoch, counted from 1."""
    at: int
    """When."""
    again: bool = False
    """It may have been delivered before, by a boot epoch that was cut short."""


class Run(Protocol):
    """A story that is being told, as its witnesses see it."""

    @property
    def drawn(self) -> RandomScenario:
        """Which."""

    @property
    def network(self) -> VirtualNetwork:
        """The nodes, as they are."""

    @property
    def casts(self) -> Mapping[int, Cast]:
        """Cast of each node's present life."""

    @property
    def settling_ns(self) -> int:
        """Time within which a frame may come a second time, ns."""


class Checker:
    """Watches; a subclass overrides what it wants to see, and appends to `violations`."""

    def __init__(self) -> None:
        self.violations: list[str] = []
        """What must not have happened, one line each."""

    def begins(self, scenario_run: Run) -> None:
        """The nodes are there, and nothing has happened yet."""

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
        """A caller has its answer, equal to the server's."""

    def failed(self, arrived: Arrived) -> None:
        """A caller got a failure."""

    def crashed(self, node: int, at: int) -> None:
        """A node has crashed; its journal is as it is found later."""

    def happened(self, node: int, event: Event, at: int) -> None:
        """An engine has emitted any event; before the method for it."""

    def ends(self, scenario_run: Run) -> None:
        """The run is over."""
