"""Quality of reception between two nodes: arriving frames, and the modems' measurements.

A frame counts as lost only while its receiver was recorded: a vehicle that is switched off before
the boat, and a recording that ends early, lose nothing.
"""

import bisect
import itertools
import struct
from collections.abc import Iterator
from typing import Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.facts import METRICS, Facts, Frame
from zacoustic.app.tools.inspect.recordings.facts.rows import Row, in_order
from zacoustic.app.tools.inspect.recordings.report.spread import Spread, spreads_of
from zacoustic.core.base.linktypes import BROADCAST

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
    for frame in facts.frames:
        if frame.is_sent:
            for pair in _expected(facts, recorded, frame):
                sent[pair] = sent.get(pair, 0) + 1
        elif frame.destination in (frame.node, BROADCAST):
            heard[frame.source, frame.node] = heard.get((frame.source, frame.node), 0) + 1
    spreads = spreads_of(facts.on_frames, facts.on_peers)
    found = []
    for source, node in sorted({*heard, *sent}):
        if source == 0:
            continue  # the link does not report the sender
        figures = LinkFigures(source=source, node=node, heard=heard.get((source, node), 0))
        if source in recorded:
            figures.sent = sent.get((source, node), 0)
            if figures.sent:
                figures.loss = max(0.0, 1 - figures.heard / figures.sent)
        for metric, name in enumerate(METRICS):
            setattr(figures, name, spreads.get((metric, source, node)))
        found.append(figures)
    return found


def _expected(facts: Facts, nodes: list[int], frame: Frame) -> Iterator[Pair]:
    """Yield the sender of a frame with each node that was recorded when it should arrive."""
    over_ns = frame.at_ns + round(frame.airtime_s * 1e9)
    for node in nodes:
        is_for = node != frame.node and frame.destination in (node, BROADCAST)
        if is_for and facts.is_recorded(node, over_ns):
            yield frame.node, node


Shares = list[tuple[int, float]]


class _Equal(Row, frozen=True):
    """A frame among equal ones of a link: first those sent, by time, then those that arrived."""

    layout = struct.Struct("<BB12s?qq")
    source: int
    node: int
    content: bytes
    is_arrival: bool
    order: int
    """UTC, ns, of a sent frame; of one that arrived its number among all frames."""
    at_ns: int


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
    counts: dict[Pair, list[int]] = {}
    got: dict[Pair, list[int]] = {}
    heard: set[Pair] = set()

    def part(utc_ns: int) -> int:
        return min(bins - 1, max(0, utc_ns - facts.began_ns) // width_ns)

    def sent() -> Iterator[_Equal]:
        nodes = facts.nodes
        for frame in facts.frames:
            for pair in _expected(facts, nodes, frame) if frame.is_sent else ():
                counts.setdefault(pair, [0] * bins)[part(frame.at_ns)] += 1
                yield _Equal(*pair, frame.content, False, frame.at_ns, frame.at_ns)

    def arrived() -> Iterator[_Equal]:
        for number, frame in enumerate(facts.frames):
            pair = frame.source, frame.node
            if not frame.is_sent and pair in counts:
                heard.add(pair)  # on a byte stream it is in other pieces than what was sent
                yield _Equal(*pair, frame.content, True, number, frame.at_ns)

    equal = itertools.groupby(
        in_order(_Equal, itertools.chain(sent(), arrived())),
        lambda each: (each.source, each.node, each.content),
    )
    for (source, node, _), frames in equal:
        known: list[int] = []
        for frame in frames:
            if not frame.is_arrival:
                known.append(frame.at_ns)
                continue
            # Of equal frames the newest that can have been this one; clocks may differ.
            place = bisect.bisect_right(known, frame.at_ns + _CLOCKS_NS)
            if place:
                got.setdefault((source, node), [0] * bins)[part(known.pop(place - 1))] += 1
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
    metric = METRICS.index(name)
    for each in itertools.chain(facts.on_frames, facts.on_peers):
        if each.what == metric:
            yield each.at_ns, (each.source, each.node), each.number
