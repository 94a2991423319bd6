"""The parts of the walk that exchanges of the model need: clock, nodes, results."""

from collections.abc import Callable
from typing import Final, Protocol

from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.app.tools.design.plan.speaker import Speaker
from zacoustic.core.base.qos import Stamp
from zacoustic.core.schedule.timing import Pacer

_ID_BYTES: Final = 1


class Clockwork(Protocol):
    """The interface of the walk for exchanges."""

    @property
    def now(self) -> int:
        """The instant, ns."""
        ...

    def later(self, at: int, action: Callable[[], object]) -> None:
        """Schedule an action at an instant, ns."""
        ...

    def speaker(self, address: int) -> Speaker:
        """Return a node."""
        ...

    def timing(self, source: int, target: int) -> Pacer:
        """Return the times in which a node answers another one."""
        ...

    def serve(self, address: int) -> None:
        """Let a node transmit, if it may."""
        ...

    def went(self, offer: Offer) -> None:
        """Note the first transmission of an item."""
        ...

    def delivered(self, offer: Offer, began_at: int) -> None:
        """Note the arrival of an item that began at an instant, ns."""
        ...


def head_bytes_of(offer: Offer) -> int:
    """Return the bytes before the payload of a best-effort sample: id, wildcards, age."""
    stamped = offer.stream.qos.stamp is Stamp.AGE
    return _ID_BYTES + len(offer.instance) + stamped
