"""The results of `zacoustic.app.tools.design.sim.simulation` and `randomscenario` for people."""

from collections.abc import Iterator, Mapping

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.design.sim.randomscenario import ScenarioResult
from zacoustic.testing.counters import SimulationResult, StreamResult

_HEADER = (
    "id", "stream", "published", "delivered", "on way", "late", "twice", "disorder", "failed",
    "refused", "50 %", "95 %", "99 %", "bytes", "share",
)  # fmt: skip


def as_text(result: SimulationResult) -> str:
    """Return the result as lines."""
    return "\n".join(_lines(result))


def scenario_as_text(result: ScenarioResult) -> str:
    """Return a random scenario and its violations as lines."""
    return "\n".join(
        (result.summary, *_lines(result.simulation), *result.violations, _verdict(result))
    )


def _verdict(result: ScenarioResult) -> str:
    number = len(result.violations)
    return f"{number} complaints" if number else "all held that must hold"


def _lines(result: SimulationResult) -> Iterator[str]:
    rows = [_cells(stream) for stream in result.streams]
    yield align(_HEADER, rows, right=[name for name in _HEADER if name != "stream"])
    busy = result.airtime_s / result.until_s
    yield (
        f"{result.frames} frames, {result.transmitted_bytes} bytes, {result.airtime_s:.1f} s of "
        f"sound in {result.until_s:g} s ({busy:.1%})"
    )
    yield f"sound by cause: {_airtimes(result.airtime_by_cause_s)}"
    yield f"frames that did not arrive: {_counts(result.losses)}"
    yield f"dropped by the engines: {_counts(result.dropped)}"
    if result.crashes:
        crashes = {f"of node {node}": number for node, number in result.crashes.items()}
        yield f"crashes: {_counts(crashes)}"
    yield f"seed {result.seed}, trace {result.digest[:16]}"


def _cells(stream: StreamResult) -> tuple[str, ...]:
    delivered = f"{stream.delivered}/{stream.expected}"
    return (
        str(stream.stream_id),
        stream.name,
        str(stream.published),
        delivered,
        str(stream.under_way) if stream.under_way else "",
        str(stream.late),
        str(stream.duplicate),
        str(stream.out_of_order),
        str(stream.failed),
        str(stream.refused),
        _seconds(stream.p50_s),
        _seconds(stream.p95_s),
        _seconds(stream.p99_s),
        str(stream.transmitted_bytes),
        f"{stream.airtime_share:.0%}",
    )


def _seconds(duration_s: float | None) -> str:
    return "" if duration_s is None else f"{duration_s:.2f} s"


def _airtimes(by_cause_s: Mapping[str, float]) -> str:
    largest_first = sorted(by_cause_s.items(), key=lambda item: -item[1])
    return ", ".join(f"{airtime_s:.1f} s {cause}" for cause, airtime_s in largest_first) or "none"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{number} {reason}" for reason, number in counts.items()) or "none"
