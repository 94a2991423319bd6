"""Quality of reception between two nodes: arriving frames, and the modems' measurements.

A frame counts as lost only while its receiver was recorded: a vehicle that is switched off before
the boat, and a recording that ends early, lose nothing.
"""

from collections.abc import Iterator
from typing import Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.facts import Facts
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


def numbers_of(facts: Facts, name: str) -> Iterator[tuple[int, Pair, float]]:
    """Yield the measurements of one kind: UTC, ns; measured and measuring node; the number.

    Args:
        facts: The events.
        name: One of `METRICS`.
    """
    for utc_ns, frame in facts.frames:
        number = getattr(frame, name, None)
        if frame.direction != SENT and frame.source and number is not None:
            yield utc_ns, (frame.source, frame.node), number
    for utc_ns, node, measured in facts.measured:
        number = getattr(measured.metrics, name)
        if number is not None:
            yield utc_ns, (measured.address, node), number
