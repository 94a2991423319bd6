"""Workers: processes on this computer, or those of an existing `dask` scheduler.

Needs dask.distributed, the extra `campaign`.
"""

import contextlib
import logging
import os
import tempfile
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from zacoustic.errors import ConfigError, ZacousticError

if TYPE_CHECKING:
    from distributed import Client

SCHEMES: Final = ("tcp://", "tls://", "ws://", "wss://")
"""Prefixes of a scheduler's address."""

# Otherwise each process would profile itself up to a hundred times a second, for a dashboard.
_SETTINGS: Final[dict[str, Any]] = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.system-monitor.interval": "10s",
}


class CampaignError(ZacousticError):
    """A run, a worker or the scheduler has failed."""


def cores() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextlib.contextmanager
def connected(
    scheduler: str | None, *, workers: int | None, patience_s: float
) -> "Iterator[Client]":
    """Yield a client whose scheduler has at least one worker.

    Args:
        scheduler: Its address; None: workers are started here, and ended with the context.
        workers: Number of workers to start; None: one for each processor.
        patience_s: Time limit for scheduler and workers, s.

    Raises:
        ConfigError: The address is not valid.
        CampaignError: No worker can be started.
        TimeoutError: Scheduler or workers are not ready in time.
    """
    from distributed import Client

    for name in ("distributed", "distributed.client"):  # relevant messages come as exceptions
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if scheduler is None:
        with _started(workers or cores()) as client:
            yield client
        return
    if not scheduler.startswith(SCHEMES):
        allowed = ", ".join(f"{scheme}HOST:PORT" for scheme in SCHEMES)
        raise ConfigError(f"--scheduler {scheduler}; allowed: {allowed}")
    with contextlib.ExitStack() as stack:
        try:
            client = stack.enter_context(
                Client(scheduler, timeout=patience_s)  # type: ignore[no-untyped-call]
            )
        except ValueError as error:
            raise ConfigError(f"--scheduler {scheduler}: {error}") from error
        except OSError as error:  # includes a time-out
            raise TimeoutError(
                f"no scheduler at {scheduler} within {patience_s:g} s (start one: dask scheduler)"
            ) from error
        try:
            client.wait_for_workers(1, timeout=patience_s)
        except TimeoutError as error:
            raise TimeoutError(no_workers(patience_s)) from error
        yield client


@contextlib.contextmanager
def _started(workers: int) -> "Iterator[Client]":
    """Start workers here.

    Raises:
        CampaignError: That is not possible.
    """
    import dask
    from distributed import Client, LocalCluster

    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(_SETTINGS))
        scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix="zacoustic-"))
        try:
            cluster = LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                memory_limit=0,
                silence_logs=logging.CRITICAL,
                local_directory=scratch,
            )
            stack.enter_context(cluster)
            client = stack.enter_context(Client(cluster))  # type: ignore[no-untyped-call]
        except (OSError, RuntimeError) as error:
            raise CampaignError(
                f"{workers} workers cannot be started here: {error.__cause__ or error}",
                hint="fewer of them: --workers N",
            ) from error
        yield client


def no_workers(patience_s: float) -> str:
    """Return the message for a missing worker."""
    return f"no worker within {patience_s:g} s; start one: dask worker tcp://HOST:PORT --nthreads 1"
