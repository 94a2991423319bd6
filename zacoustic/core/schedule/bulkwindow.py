"""How many frames of a bulk service are under way at a time.

The device sends them in *trains* of as many as it likes, and reports a train at once when it is
acknowledged. Its buffer must hold the next train before that, or it would stop; but every frame in
it delays what must wait until the buffer is empty, such as a pause in which other nodes are heard.
So the window is twice the largest train of late, and one more. The one more finds out whether the
device would send longer trains.
"""

from typing import Final

from zacoustic.core.base.linktypes import BulkService, TransmitOutcome, TransmitReport
from zacoustic.core.base.parts import Part

_FIRST_WINDOW: Final = 8
_LATELY_TRAINS: Final = 8
"""A train counts for the window until this many later ones have been reported."""
_SAME_TRAIN_NS: Final = 250_000_000
"""Reports of one train come closer together than this: a serial line takes a while for them."""


class BulkWindow:
    """The frames of a bulk service under way.

    Args:
        service: The service.
    """

    def __init__(self, service: BulkService) -> None:
        self.service = service
        """The service."""
        self._outstanding: dict[int, tuple[Part, ...]] = {}
        self._trains: list[int] = []
        self._train = 0
        self._reported_at: int | None = None

    def __len__(self) -> int:
        return len(self._outstanding)

    def __contains__(self, transmission_id: int) -> bool:
        return transmission_id in self._outstanding

    @property
    def size(self) -> int:
        """The most frames under way."""
        largest = max((*self._trains, self._train), default=0)
        window = 2 * largest + 1 if largest else _FIRST_WINDOW
        return min(window, self.service.most_outstanding)

    @property
    def is_full(self) -> bool:
        """Whether a report must come before another frame goes."""
        return len(self._outstanding) >= self.size

    def give(self, transmission_id: int, parts: tuple[Part, ...]) -> None:
        """Record a frame that is given to the link."""
        self._outstanding[transmission_id] = parts

    def take(self, report: TransmitReport) -> tuple[Part, ...]:
        """Record the report of a frame under way; return what follows it."""
        if report.outcome is TransmitOutcome.DELIVERED:
            last_at, at = self._reported_at, report.finished_at
            if self._train and last_at is not None and at - last_at >= _SAME_TRAIN_NS:
                self._trains = [*self._trains, self._train][-_LATELY_TRAINS:]
                self._train = 0
            self._train += 1
            self._reported_at = at
        return self._outstanding.pop(report.transmission_id)

    def take_all(self) -> dict[int, tuple[Part, ...]]:
        """Forget all frames under way; return what follows them, by transmission."""
        outstanding, self._outstanding = self._outstanding, {}
        return outstanding
