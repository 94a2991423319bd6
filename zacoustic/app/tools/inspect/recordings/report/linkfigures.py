"""Quality of reception between two nodes: arriving frames, and the modems' measurements.

A frame counts as lost only while its receiver was recorded: a vehicle that is switched off before
the boat, and a recording that ends early, lose nothing.
"""

import bisect
from collections.abc import Iterator
from typing import Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.facts import Facts
from zacoustic.app.tools.inspect.recordings.facts.framecolumns import FrameColumns
from zacoustic.app.tools.inspect.recordings.report.spread import Spread, spread_of
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.run.recording.channels import SENT

METRICS: Final = (
    "snr_db",
    "received_level_db",
    "integrity",
    "propagation_s",
    "range_m",
    "range_rate_m_s",
)
"""Quantities that a modem may measure, as in `LinkMetrics`, in the order of the table."""

_CLOCKS_NS: Final = 1_000_000_000
"""By how much the clocks of two recordings may differ, ns."""
Pair = tuple[int, int]


class LinkFigures(msgspec.Struct, kw_only=True):
    """Figures from one node to another."""

    source: int
    """The sender."""
    node: int
    """The receiver."""
    heard: int = 0
    """Frames that arrived."""
    sent: int | None = None
    """Frames for it or broadcast, while it was recorded; None: the sender is not recorded."""
    loss: float | None = None
    """Share of them that did not arrive, for any reason, 0…1."""
    snr_db: Spread | None = None
    """Signal-to-noise ratio, dB."""
    received_level_db: Spread | None = None
    """Received level, dB, in the modem's own scale."""
    integrity: Spread | None = None
    """Signal quality in the modem's own scale."""
    propagation_s: Spread | None = None
    """Propagation delay, s."""
    range_m: Spread | None = None
    """Slant distance, m."""
    range_rate_m_s: Spread | None = None
    """Relative velocity, m/s, positive when the distance grows."""


def links_of(facts: Facts) -> list[LinkFigures]:
    """Compute the figures, by sender and receiver."""
    heard: dict[Pair, int] = {}
    sent: dict[Pair, int] = {}
    recorded = facts.nodes
    for utc_ns, frame in facts.frames:
        if frame.direction == SENT:
            over_ns = utc_ns + round((frame.airtime_s or 0.0) * 1e9)
            for node in recorded:
                is_for = node != frame.node and frame.destination in (node, BROADCAST)
                if is_for and facts.is_recorded(node, over_ns):
                    sent[frame.node, node] = sent.get((frame.node, node), 0) + 1
        elif frame.destination in (frame.node, BROADCAST):
            heard[frame.source, frame.node] = heard.get((frame.source, frame.node), 0) + 1
    measured: dict[tuple[Pair, str], list[float]] = {}
    for name in METRICS:
        for _, pair, number in numbers_of(facts, name):
            measured.setdefault((pair, name), []).append(number)
    found = []
    for source, node in sorted({*heard, *sent}):
        if source == 0:
            continue  # the link does not report the sender
        figures = LinkFigures(source=source, node=node, heard=heard.get((source, node), 0))
        if source in recorded:
            figures.sent = sent.get((source, node), 0)
            if figures.sent:
                figures.loss = max(0.0, 1 - figures.heard / figures.sent)
        for name in METRICS:
            setattr(figures, name, spread_of(measured.get(((source, node), name), [])))
        found.append(figures)
    return found


Shares = list[tuple[int, float]]


def losses_over_time(facts: Facts, bins: int) -> dict[Pair, Shares]:
    """Return the share of frames that did not arrive, in equal parts of the time.

    A frame counts, sent and arrived, in the part in which its link was given it: burst data may
    wait in the device for minutes, and arrive in another part.

    Args:
        facts: The events.
        bins: Number of parts.

    Returns:
        For each sender and receiver the parts in which frames were sent: index and share, 0…1.
    """
    width_ns = max(1, (facts.ended_ns - facts.began_ns) // bins)
    sent: dict[tuple[Pair, bytes], list[int]] = {}
    counts: dict[Pair, list[int]] = {}
    got: dict[Pair, list[int]] = {}
    heard: set[Pair] = set()

    def part(utc_ns: int) -> int:
        return min(bins - 1, max(0, utc_ns - facts.began_ns) // width_ns)

    nodes = facts.nodes
    for utc_ns, frame in facts.frames:
        if frame.direction != SENT:
            continue
        over_ns = utc_ns + round((frame.airtime_s or 0.0) * 1e9)
        for node in nodes:
            is_for = node != frame.node and frame.destination in (node, BROADCAST)
            if is_for and facts.is_recorded(node, over_ns):
                pair = frame.node, node
                sent.setdefault((pair, frame.frame), []).append(utc_ns)
                counts.setdefault(pair, [0] * bins)[part(utc_ns)] += 1
    for each in sent.values():
        each.sort()
    for utc_ns, frame in facts.frames:
        pair = frame.source, frame.node
        if frame.direction == SENT or pair not in counts:
            continue
        heard.add(pair)  # on a byte stream it is in other pieces than what was sent
        # Of equal frames the newest that can have been this one; clocks may differ.
        known = sent.get((pair, frame.frame), [])
        place = bisect.bisect_right(known, utc_ns + _CLOCKS_NS)
        if place:
            got.setdefault(pair, [0] * bins)[part(known.pop(place - 1))] += 1
    nothing = [0] * bins
    return {
        pair: [
            (index, 1 - came / number)
            for index, (number, came) in enumerate(zip(row, got.get(pair, nothing), strict=True))
            if number
        ]
        for pair, row in sorted(counts.items())
        if pair in got or pair not in heard
    }


def numbers_of(facts: Facts, name: str) -> Iterator[tuple[int, Pair, float]]:
    """Yield the measurements of one kind: UTC, ns; measured and measuring node; the number.

    Args:
        facts: The events.
        name: One of `METRICS`.
    """
    if isinstance(facts.frames, FrameColumns):
        yield from facts.frames.measured(name)
    else:
        for utc_ns, frame in facts.frames:
            number = getattr(frame, name, None)
            if frame.direction != SENT and frame.source and number is not None:
                yield utc_ns, (frame.source, frame.node), number
    for utc_ns, node, measured in facts.measured:
        number = getattr(measured.metrics, name)
        if number is not None:
            yield utc_ns, (measured.address, node), number
