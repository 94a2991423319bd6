"""A mule between two nodes that never hear each other: 1 publishes, 3 subscribes, 2 passes both.

For the first `STAYS_S` of each period the mule is beside node 1, half a period later beside node 3.
"""

import random
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final

from tests.virtual.twolinks import medium
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import (
    CustodyChanged,
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    Event,
    SampleReceived,
)
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import NodeDownError, VirtualNetwork

MOORING, MULE, SHIP = 1, 2, 3
LOG, PHOTO = 1, 2
PERIOD_S: Final = 3600.0
STAYS_S: Final = 300.0
MODEM: Final = "evologics_s2c_18_34"
HEARTBEAT_S: Final = 30.0
HEARD: Final = TransmitRules(contact=ContactRules(heartbeat_s=HEARTBEAT_S))
"""Who meets others for minutes must say that it is there: nobody calls out for ever."""


def table(
    *, by: tuple[int, ...] = (MULE,), after_s: float = 120.0, expires_s: float = 86400.0,
    depth: int = 2000, nodes: Sequence[int] = (MOORING, MULE, SHIP),
) -> StreamTable:  # fmt: skip
    """Return the table of all nodes."""
    ends: dict[str, Any] = {
        "publishers": (MOORING,), "subscribers": (SHIP,), "journal": True,
        "qos": Qos(reliability=Reliability.RELIABLE, depth=depth),
        "carry": Carry(by=by, after_s=after_s, expires_s=expires_s),
    }  # fmt: skip
    return StreamTable(
        [TopicSpec(stream_id=LOG, name="log", **ends),
         TopicSpec(stream_id=PHOTO, name="photo", **ends)],
        nodes={each: f"n{each}" for each in nodes},
    )  # fmt: skip


def passes(source: int, node: int, now: int) -> bool:
    """Return whether two nodes hear each other at an instant, ns."""
    at_s = now / NS_PER_S % PERIOD_S
    ends = {source, node}
    if ends == {MOORING, MULE}:
        return at_s < STAYS_S
    if ends == {MULE, SHIP}:
        return PERIOD_S / 2 <= at_s < PERIOD_S / 2 + STAYS_S
    return False


class Voyage:
    """The three nodes, and what they told.

    Args:
        seed: Everything follows from it.
        loss: Share of the frames that are lost.
        hears: Whether two nodes hear each other at an instant, ns.
        copies: Extra arrivals of each frame, s after the first.
        more: Arguments of `VirtualNetwork`.
    """

    def __init__(
        self,
        seed: int = 1,
        *,
        loss: float = 0.0,
        hears: Callable[[int, int, int], bool] = passes,
        copies: Sequence[float] = (),
        nodes: Sequence[int] = (MOORING, MULE, SHIP),
        **more: Any,
    ) -> None:
        self.rng = random.Random(seed)
        self.given: list[bytes] = []
        """Everything that was published."""
        self.lives: dict[bytes, int] = {}
        """By value, the boot epoch of the mooring in which it was published."""
        self.got: list[tuple[bytes, bool]] = []
        """What the ship was handed on, and whether perhaps again."""
        self.got_s: dict[bytes, float] = {}
        self.samples: list[SampleReceived] = []
        """The same as events."""
        self.may_end_again = False
        """An old copy of the mooring's journal was restored."""
        self.outcomes: dict[bytes, DeliveryOutcome] = {}
        self.details: dict[bytes, str] = {}
        """What else was told of each end."""
        self.stored: set[bytes] = set()
        """What survives a restart of the mooring."""
        self._values: dict[int, bytes] = {}
        self.custody: list[CustodyChanged] = []

        def disturb(source: int, node: int, now: int) -> Sequence[float]:
            if not hears(source, node, now) or self.rng.random() < loss:
                return ()
            return (0.0, *copies)

        more.setdefault("table", table(nodes=nodes))
        more.setdefault("rules", HEARD)
        self.network = VirtualNetwork(
            medium(max(nodes), apart_m=300.0, profile=MODEM, loss=0.0, seed=seed),
            deliver=self._happened,
            disturb=disturb,
            **more,
        )

    @property
    def now_s(self) -> float:
        """The instant, s."""
        return self.network.now / NS_PER_S

    def publish(self, value: bytes, stream_id: int = LOG) -> None:
        """Publish a sample at the mooring, if that is up."""
        self.given.append(value)
        try:
            self.lives[value] = self.network.engine(MOORING).epoch
            self._values[self.network.publish(MOORING, stream_id, value)] = value
        except NodeDownError:
            self.given.remove(value)

    def publish_at(self, at_s: float, value: bytes, stream_id: int = LOG) -> None:
        """Publish a sample at an instant, s."""
        self.network.at(at_s, lambda: self.publish(value, stream_id))

    @property
    def ended(self) -> Counter[DeliveryOutcome]:
        """How many samples have ended in which way."""
        return Counter(self.outcomes.values())

    def _value_of(self, delivery_id: int) -> bytes:
        return self._values.get(delivery_id, self.given[-1])  # it may come before the id is known

    def _happened(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and address == SHIP:
            self.samples.append(event)
            self.got.append((event.value, event.again))
            self.got_s.setdefault(event.value, self.now_s)
        elif isinstance(event, DeliveryStored):
            self.stored.add(self._value_of(event.delivery_id))
        elif isinstance(event, DeliveryEnded):
            value = self._value_of(event.delivery_id)
            is_known = event.delivery_id in self._values
            assert not is_known or value not in self.outcomes or self.may_end_again, "ended twice"
            self.outcomes[value], self.details[value] = event.outcome, event.detail
        elif isinstance(event, CustodyChanged):
            self.custody.append(event)
