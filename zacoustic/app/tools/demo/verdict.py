"""The end of the demo: what crossed, its cost, and whether everything did."""

from collections.abc import Iterator

import msgspec

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.demo.lanes import Lane
from zacoustic.app.tools.demo.logbook import Logbook, network_name

_HEADER = ("stream", "from", "sent", "crossed", "mean delay", "bytes", "airtime")
_RIGHT = ("sent", "crossed", "mean delay", "bytes", "airtime")


class LaneSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One direction of one stream."""

    stream: str
    """Name of the stream, for a service with `request` or `response`."""
    source: str
    """Name of the sending side."""
    sent: int
    """Number of items put on that side."""
    crossed: int
    """Number of items that reached a client on the other side."""
    mean_delay_s: float | None
    """From client to client, s; None when nothing crossed."""
    transmitted_bytes: int | None
    """Bytes on the link, headers included; None if the gateway did not report them."""
    airtime_share: float | None
    """Its share of all bytes on the channel, 0…1."""


class Summary(msgspec.Struct, frozen=True, kw_only=True, tag="summary", tag_field="event"):
    """The result of the demo."""

    ok: bool
    """Everything that should cross did, unchanged and once, except for lost best-effort samples."""
    missing: tuple[str, ...]
    """Items that did not, or arrived changed; one line each."""
    lost: tuple[str, ...] = ()
    """Best-effort samples in lost frames; one line for each stream."""
    duration_s: float
    """From the word `go` to the end, s."""
    streams: tuple[LaneSummary, ...]
    """Result of each stream."""
    frames: int
    """Frames on the channel."""
    lost_frames: int
    """Number of lost frames; their contents crossed in another frame, or are missing."""
    transmitted_bytes: int
    """Bytes in those frames."""
    overhead_bytes: int
    """Bytes of no stream: introductions."""
    airtime_s: float
    """Airtime of all frames, s."""


def summary_of(logbook: Logbook, problems: tuple[str, ...] = ()) -> Summary:
    """Summarise a run.

    Args:
        logbook: Log of the run.
        problems: Other faults, such as a process that died.
    """
    missing = (*problems, *_missing(logbook))
    total = logbook.transmitted_bytes
    return Summary(
        ok=not missing,
        missing=missing,
        lost=tuple(_line(lane) for lane in logbook.lanes if _is_lost(lane, logbook)),
        duration_s=round(logbook.elapsed_s, 3),
        streams=tuple(_lane_summaries(logbook, total)),
        frames=len(logbook.frames),
        lost_frames=logbook.lost_frames(),
        transmitted_bytes=total,
        overhead_bytes=sum(logbook.overhead_bytes.values()),
        airtime_s=round(logbook.airtime_s, 3),
    )


def _lane_summaries(logbook: Logbook, total_bytes: int) -> Iterator[LaneSummary]:
    for lane in logbook.lanes:
        delay_s, size = lane.mean_delay_s, lane.transmitted_bytes
        yield LaneSummary(
            stream=lane.name,
            source=network_name(lane.source),
            sent=lane.sent,
            crossed=lane.crossed,
            mean_delay_s=None if delay_s is None else round(delay_s, 3),
            transmitted_bytes=size,
            airtime_share=None if size is None or not total_bytes else round(size / total_bytes, 4),
        )


def _missing(logbook: Logbook) -> Iterator[str]:
    if logbook.began_at is None:
        return  # the error that stopped it before the start says more
    for lane in logbook.lanes:
        head = f"{lane.name} from {network_name(lane.source)}"
        if not lane.sent:
            yield f"{head}: nothing was sent"
        if lane.missing and not _is_lost(lane, logbook):
            yield _line(lane)
        yield from (f"{head}: number {fault}" for fault in lane.faults)
    for client in sorted({"vehicle", "console"} - logbook.done):
        yield f"{client}: not done with what it had to do"


def _is_lost(lane: Lane, logbook: Logbook) -> bool:
    """Tell whether the missing samples are explained: each was sent once, in a lost frame."""
    return not lane.is_repeated and 0 < len(lane.missing) <= logbook.lost_frames(lane.source)


def _line(lane: Lane) -> str:
    numbers = ", ".join(map(str, lane.missing))
    missing = f"{len(lane.missing)} of {lane.sent} did not cross (number {numbers})"
    return f"{lane.name} from {network_name(lane.source)}: {missing}"


def as_text(summary: Summary) -> str:
    """Return the summary as lines for people."""
    rows = [_cells(lane) for lane in summary.streams]
    overhead = summary.overhead_bytes
    share = f"{overhead / summary.transmitted_bytes:.0%}" if summary.transmitted_bytes else ""
    rows.append(("(who speaks, which table)", "all", "", "", "", str(overhead), share))
    rate = summary.airtime_s / summary.duration_s if summary.duration_s else 0.0
    lines = [
        align(_HEADER, rows, right=_RIGHT),
        f"{summary.frames} frames, {summary.lost_frames} lost, {summary.transmitted_bytes} bytes, "
        f"{summary.airtime_s:.2f} s of airtime in {summary.duration_s:.1f} s ({rate:.0%})",
        *(f"missing: {line}" for line in summary.missing),
        *(f"lost on the channel, best effort: {line}" for line in summary.lost),
        _conclusion(summary),
    ]
    return "\n".join(lines)


def _conclusion(summary: Summary) -> str:
    if not summary.ok:
        return "not everything crossed"
    return "everything else crossed" if summary.lost else "everything crossed"


def _cells(lane: LaneSummary) -> tuple[str, ...]:
    delay = "" if lane.mean_delay_s is None else f"{lane.mean_delay_s:.2f} s"
    size = "?" if lane.transmitted_bytes is None else str(lane.transmitted_bytes)
    share = "" if lane.airtime_share is None else f"{lane.airtime_share:.0%}"
    return (lane.stream, lane.source, str(lane.sent), str(lane.crossed), delay, size, share)
