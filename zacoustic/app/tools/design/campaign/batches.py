"""Which runs go to a worker together: as many as take about two seconds.

A scheduler takes some milliseconds for a task, a run of ten minutes with two nodes no more than
that. A batch of two seconds makes that 1 % at most, is soon done again when a worker dies with it,
and keeps results coming. Towards the end batches become smaller, so that all workers end together.
What a run of a cell takes is known from the seeds that the cell has had.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from zacoustic.app.tools.design.campaign.campaign import Campaign
from zacoustic.app.tools.design.campaign.running import Row

TARGET_S: Final = 2.0
_SHARE_OF_REST: Final = 3
"""A batch is at most the share of one worker in this part of what is left: one in three."""


class Batches:
    """The runs that are still to be done.

    Args:
        campaign: Theirs.
        missing: Their numbers, in order.
        rows: What is known already.
    """

    def __init__(self, campaign: Campaign, missing: Iterable[int], rows: Iterable[Row]) -> None:
        self._campaign = campaign
        self._waiting = deque(missing)
        self._took_s: dict[int, float] = {}
        self._sum_s = 0.0
        self._count = 0
        self.note(rows)

    def __len__(self) -> int:
        return len(self._waiting)

    def note(self, rows: Iterable[Row]) -> None:
        """Learn how long runs take."""
        for row in rows:
            self._took_s[self._campaign.cell_of(row.run)] = row.took_s
            self._sum_s += row.took_s
            self._count += 1

    def take(self, workers: int) -> list[int]:
        """Take the next batch; empty: nothing is left.

        Args:
            workers: How many there are.
        """
        most = max(1, len(self._waiting) // (_SHARE_OF_REST * max(1, workers)))
        batch: list[int] = []
        batch_s = 0.0
        while self._waiting and len(batch) < most and batch_s < TARGET_S:
            run = self._waiting.popleft()
            batch.append(run)
            batch_s += self._expected_s(run)
        return batch

    def _expected_s(self, run: int) -> float:
        known_s = self._took_s.get(self._campaign.cell_of(run))
        if known_s is not None:
            return known_s
        # Nothing is known at the beginning: one run each, to learn of.
        return self._sum_s / self._count if self._count else TARGET_S
