"""Execution of a campaign: batches to workers, rows back, until nothing is missing.

A task of the scheduler is a batch. When a worker dies, the scheduler gives its batches to another
one; the rows are the same. Rows are stored as soon as their batch is done, so that a repeated start
runs only the missing ones.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Final

import msgspec

from zacoustic.app.tools.design.campaign.batches import Batches
from zacoustic.app.tools.design.campaign.campaign import Campaign
from zacoustic.app.tools.design.campaign.cluster import CampaignError, no_workers
from zacoustic.app.tools.design.campaign.running import Batch, Row, run_batch
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from distributed import Client, Future

_AHEAD: Final = 2
"""Batches of each worker at a time: one in work, and the next one."""
_LOOK_S: Final = 1.0
"""Period of counting workers, s."""
_AGAIN: Final = "start it again to go on: what is done is kept"


def carry_out(
    client: "Client",
    campaign: Campaign,
    known: Iterable[Row],
    *,
    take: Callable[[Sequence[Row]], None],
    patience_s: float,
) -> None:
    """Do all missing runs.

    Args:
        client: Client of a scheduler.
        campaign: The campaign.
        known: Rows of finished runs.
        take: Takes new rows, in any order.
        patience_s: Longest time without a worker, s.

    Raises:
        ConfigError: A value of the campaign is not allowed.
        CampaignError: A run has failed, or the scheduler is lost.
        TimeoutError: There is no worker.
    """
    known = list(known)
    done = {row.run for row in known}
    missing = (run for run in range(campaign.runs) if run not in done)
    _Carrying(client, campaign, Batches(campaign, missing, known), take, patience_s).run()


class _Carrying:
    """The execution of one campaign."""

    def __init__(
        self,
        client: "Client",
        campaign: Campaign,
        batches: Batches,
        take: Callable[[Sequence[Row]], None],
        patience_s: float,
    ) -> None:
        self._client = client
        self._campaign = campaign
        self._payload = msgspec.json.encode(campaign)
        self._batches = batches
        self._take = take
        self._patience_s = patience_s
        self._pending: dict[Future[bytes], list[int]] = {}
        self._workers = 0
        self._looked_s = -_LOOK_S
        self._alone_s: float | None = None

    def run(self) -> None:
        """Do everything."""
        while len(self._batches) or self._pending:
            self._look()
            self._submit()
            for future in self._done():
                self._finish(future, self._pending.pop(future))

    def _done(self) -> "set[Future[bytes]]":
        """Wait for batches, for a while."""
        from distributed import CancelledError, wait

        try:
            found = wait(list(self._pending), _LOOK_S, "FIRST_COMPLETED")  # type: ignore[no-untyped-call]
        except TimeoutError:
            return set()
        except (CancelledError, OSError) as error:
            raise _gone() from error
        return set(found.done)

    def _look(self) -> None:
        """Count the workers periodically."""
        now_s = time.monotonic()
        if now_s < self._looked_s + _LOOK_S:
            return
        self._looked_s = now_s
        try:
            threads = self._client.nthreads()  # type: ignore[no-untyped-call]
        except (OSError, RuntimeError) as error:
            raise _gone() from error
        self._workers = sum(threads.values())
        if self._workers:
            self._alone_s = None
            return
        self._alone_s = now_s if self._alone_s is None else self._alone_s
        if now_s > self._alone_s + self._patience_s:
            raise TimeoutError(f"{no_workers(self._patience_s)}; {_AGAIN}")

    def _submit(self) -> None:
        """Keep every worker busy."""
        while len(self._pending) < _AHEAD * max(1, self._workers):
            runs = self._batches.take(self._workers)
            if not runs:
                return
            future = self._client.submit(run_batch, self._payload, runs, pure=False)
            self._pending[future] = runs

    def _finish(self, future: "Future[bytes]", runs: list[int]) -> None:
        from distributed import CancelledError

        try:
            result = future.result()
        except (CancelledError, OSError) as error:  # a batch returns the failures of its runs
            raise _gone() from error
        except Exception as error:  # of the scheduler: workers have died of this batch repeatedly
            names = self._named(runs[0]) + (f" and {len(runs) - 1} more" if runs[1:] else "")
            raise CampaignError(
                f"no worker could run {names}: {type(error).__name__}: {error}", hint=_AGAIN
            ) from error
        batch = msgspec.json.decode(result, type=Batch)
        self._take(batch.rows)
        self._batches.note(batch.rows)
        if batch.failure is not None:
            failure = batch.failure
            if failure.is_usage:
                raise ConfigError(failure.reason, hint=failure.hint)
            raise CampaignError(f"{self._named(failure.run)}: {failure.reason}", hint=_AGAIN)

    def _named(self, run: int) -> str:
        cell = self._campaign.named(self._campaign.cell_of(run))
        return f"the run with {cell}, seed {self._campaign.seed_of(run)}"


def _gone() -> CampaignError:
    return CampaignError("the scheduler is gone", hint=_AGAIN)
