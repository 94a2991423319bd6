"""Runs of a campaign on a worker: a batch in, its rows out, both as bytes.

A worker may be a process on another machine. It gets the whole campaign with each batch and parses
it once. A run depends only on its campaign and its number, so the row is always the same.
"""

import functools
import gc
import time
from collections.abc import Iterator
from importlib import metadata
from typing import Final

import msgspec

from zacoustic.app.tools.design.campaign.campaign import Campaign
from zacoustic.app.tools.design.sim.simulation import simulate_scenario
from zacoustic.errors import ConfigError
from zacoustic.testing.counters import SimulationResult

Figure = int | float | None
"""Value of a figure; None: it has none, for example the latency of samples that never arrived."""

OVERALL: Final = (
    "published", "expected", "delivered", "delivery", "late", "duplicate", "out_of_order",
    "failed", "refused", "mean_s", "p50_s", "p95_s", "p99_s", "frames", "transmitted_bytes",
    "airtime_s", "utilisation", "lost", "dropped", "crashes",
)  # fmt: skip
"""Figures over all streams."""
PER_STREAM: Final = (
    "delivery", "late", "failed", "mean_s", "p50_s", "p95_s", "transmitted_bytes", "airtime_s"
)  # fmt: skip
"""Figures of one stream; tables name them ``STREAM: FIGURE``."""
_COUNTED: Final = (
    "published", "expected", "delivered", "late", "duplicate", "out_of_order", "failed", "refused"
)  # fmt: skip


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a run."""

    run: int
    """Its number."""
    figures: dict[str, Figure]
    """By name: those of `OVERALL`, then those of each stream."""
    digest: str
    """SHA-256 of the trace of all engines."""
    took_s: float
    """Processor time, s; in no table."""


class Failure(msgspec.Struct, frozen=True):
    """Why a batch ended early."""

    run: int
    """The run."""
    reason: str
    """Error, one line."""
    hint: str = ""
    """What to do about it."""
    is_usage: bool = False
    """A file is wrong, not the program."""


class Batch(msgspec.Struct, frozen=True):
    """The result of a batch."""

    rows: list[Row]
    """Rows of the finished runs."""
    failure: Failure | None = None
    """Failure of a run; None: all are finished."""


def run_batch(campaign: bytes, runs: list[int]) -> bytes:
    """Do some runs; for workers.

    Args:
        campaign: A `Campaign`, as JSON.
        runs: Numbers of the runs.

    Returns:
        A `Batch`, as JSON.
    """
    rows: list[Row] = []
    failure = None
    for run in runs:
        try:
            rows.append(row_of(_read(campaign), run))
        except ConfigError as error:
            failure = Failure(run, error.args[0], error.hint, is_usage=True)
        except Exception as error:  # reported with its run where somebody reads it
            failure = Failure(run, f"{type(error).__name__}: {error}")
        if failure is not None:
            break
    return msgspec.json.encode(Batch(rows, failure))


def row_of(campaign: Campaign, run: int) -> Row:
    """Do one run.

    Raises:
        ConfigError: The campaign has a value that is not allowed.
    """
    began_s = time.process_time()
    cell, seed = campaign.cell_of(run), campaign.seed_of(run)
    scenario, configs = campaign.scenario_of(cell, seed)
    source = f"{campaign.place} with {campaign.named(cell)}"
    result = simulate_scenario(scenario, configs, source=source, until_s=campaign.until_s)
    return Row(
        run=run,
        figures=dict(_figures(result)),
        digest=result.digest,
        took_s=time.process_time() - began_s,
    )


def version() -> str:
    """Return the version of zacoustic here."""
    return metadata.version("zacoustic")


@functools.lru_cache(maxsize=1)
def _read(campaign: bytes) -> Campaign:
    """Parse a campaign, and compare this computer with the one that made it.

    Raises:
        ConfigError: This computer has another version, or a file is missing.
    """
    read = msgspec.json.decode(campaign, type=Campaign)
    if read.version != version():
        raise ConfigError(
            f"a worker has zacoustic {version()}, the campaign is of {read.version}",
            hint="install the same version for all workers",
        )
    read.check_files()
    # Loaded objects stay; excluding them from garbage collection saves a tenth of each run.
    gc.collect()
    gc.freeze()
    return read


def _figures(result: SimulationResult) -> Iterator[tuple[str, Figure]]:
    totals = {name: sum(getattr(each, name) for each in result.streams) for name in _COUNTED}
    all_streams: dict[str, Figure] = {
        **totals,
        "delivery": _share(totals["delivered"], totals["expected"]),
        "utilisation": result.airtime_s / result.until_s,
        "lost": sum(result.losses.values()),
        "dropped": sum(result.dropped.values()),
        "crashes": sum(result.crashes.values()),
    }
    for name in OVERALL:
        yield name, all_streams[name] if name in all_streams else getattr(result, name)
    for stream in result.streams:
        of_stream: dict[str, Figure] = {
            "delivery": _share(stream.delivered, stream.expected),
            "airtime_s": sum(stream.airtime_s.values()),
        }
        for name in PER_STREAM:
            figure = of_stream[name] if name in of_stream else getattr(stream, name)
            yield f"{stream.name}: {name}", figure


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None
