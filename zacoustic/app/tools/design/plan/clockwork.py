"""What the exchanges of the model need of the walk: the clock, the nodes, the listeners."""

from collections.abc import Callable
from typing import Final, Protocol

from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.app.tools.design.plan.speaker import Speaker
from zacoustic.core.base.qos import Stamp
from zacoustic.core.schedule.timing import Pacer

_ID_BYTES: Final = 1


class Clockwork(Protocol):
    """What exchanges need of the walk."""

    @property
    def now(self) -> int:
        """The instant, ns."""
        ...

    def later(self, at: int, action: Callable[[], object]) -> None:
        """Do something at an instant, ns."""
        ...

    def speaker(self, address: int) -> Speaker:
        """Return a node."""
        ...

    def timing(self, source: int, target: int) -> Pacer:
        """Return how long a node takes to answer another one."""
        ...

    def serve(self, address: int) -> None:
        """Let a node transmit, if it may."""
        ...

    def went(self, offer: Offer) -> None:
        """Something is transmitted for the first time."""
        ...

    def delivered(self, offer: Offer, began_at: int) -> None:
        """Something from that instant has arrived."""
        ...


def head_bytes_of(offer: Offer) -> int:
    """Return what stands before the payload of a best-effort sample: id, wildcards, age."""
    stamped = offer.stream.qos.stamp is Stamp.AGE
    return _ID_BYTES + len(offer.instance) + stamped
