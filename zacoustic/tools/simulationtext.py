"""The result of `zacoustic.tools.simulation` for people."""

from collections.abc import Iterator, Mapping

from zacoustic.tools.columns import align
from zacoustic.tools.simulation import SimulationResult, StreamResult

_HEADER = (
    "id", "stream", "published", "delivered", "failed", "refused", "mean", "95 %", "bytes", "share",
)  # fmt: skip


def as_text(result: SimulationResult) -> str:
    """Return the result as lines."""
    return "\n".join(_lines(result))


def _lines(result: SimulationResult) -> Iterator[str]:
    rows = [_cells(stream) for stream in result.streams]
    yield align(_HEADER, rows, right=[name for name in _HEADER if name != "stream"])
    busy = result.airtime_s / result.until_s
    yield (
        f"{result.frames} frames, {result.transmitted_bytes} bytes, {result.airtime_s:.1f} s of "
        f"sound in {result.until_s:g} s ({busy:.1%})"
    )
    yield f"frames that did not arrive: {_counts(result.losses)}"
    yield f"dropped by the engines: {_counts(result.dropped)}"
    yield f"seed {result.seed}, trace {result.digest[:16]}"


def _cells(stream: StreamResult) -> tuple[str, ...]:
    return (
        str(stream.stream_id),
        stream.name,
        str(stream.published),
        str(stream.delivered),
        str(stream.failed),
        str(stream.refused),
        _seconds(stream.mean_s),
        _seconds(stream.p95_s),
        str(stream.transmitted_bytes),
        f"{stream.airtime_share:.0%}",
    )


def _seconds(duration_s: float | None) -> str:
    return "" if duration_s is None else f"{duration_s:.2f} s"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{number} {reason}" for reason, number in counts.items()) or "none"
