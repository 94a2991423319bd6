"""Batches of runs for workers: as many runs as take about two seconds.

A scheduler needs some milliseconds for a task, and a run of ten minutes with two nodes takes no
longer. With batches of two seconds that overhead is 1 % at most, a batch lost with its worker is
soon repeated, and results keep coming. Towards the end batches become smaller, so that all workers
end together. The time of a cell's run is estimated from the seeds that it has had.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from zacoustic.app.tools.design.campaign.campaign import Campaign
from zacoustic.app.tools.design.campaign.running import Row

TARGET_S: Final = 2.0
_SHARE_OF_REST: Final = 3
"""A batch is at most one worker's share of the remaining work, divided by this."""


class Batches:
    """The missing runs.

    Args:
        campaign: The campaign.
        missing: Numbers of the missing runs, in order.
        rows: Known rows.
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
        """Learn the duration of runs."""
        for row in rows:
            self._took_s[self._campaign.cell_of(row.run)] = row.took_s
            self._sum_s += row.took_s
            self._count += 1

    def take(self, workers: int) -> list[int]:
        """Take the next batch; empty: no run is left.

        Args:
            workers: Number of workers.
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
        # At the beginning nothing is known: one run each, to learn from.
        return self._sum_s / self._count if self._count else TARGET_S
