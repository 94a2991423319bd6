"""Figures of a recording: delivery, latency, airtime and link quality.

Guarantees: the bytes of a node are those of its frames, and its ledger equals them exactly, or
`ledger_is_exact` is false. A latency is from the command to the arrival, by the clocks of the two
nodes if they differ.
"""

import itertools
from collections import Counter
from typing import Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.facts import (
    Counts,
    Facts,
    Handled,
    Number,
    Transmitted,
)
from zacoustic.app.tools.inspect.recordings.facts.matching import match
from zacoustic.app.tools.inspect.recordings.facts.rows import Rows
from zacoustic.app.tools.inspect.recordings.report.linkfigures import LinkFigures, links_of
from zacoustic.app.tools.inspect.recordings.report.spread import Spread, spreads_of
from zacoustic.app.tools.inspect.recordings.report.thinning import left_out
from zacoustic.core.base.stats import NO_STREAM
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import Stream
from zacoustic.run.recording.version import program

_NAMED: Final = 5
"""Number of streams to name, the worst first."""


class StreamFigures(msgspec.Struct, kw_only=True):
    """Figures of one stream."""

    stream_id: int
    """Its id."""
    name: str
    """Its name."""
    kind: str
    """`topic`, `service` or `action`."""
    published: int = 0
    """Samples published, calls made or goals sent by recorded nodes."""
    expected: int = 0
    """Samples that would have arrived at recorded nodes without losses; calls and goals. Without
    those left out on purpose."""
    thinned: int = 0
    """Samples replaced by newer ones because of `min_interval_s`: not lost."""
    delivered: int = 0
    """Samples of recorded nodes that arrived at recorded nodes; answered calls and goals."""
    arrived: int = 0
    """Samples that arrived at recorded nodes, from any node."""
    failed: int = 0
    """Calls and goals that ended without an answer."""
    refused: int = 0
    """Commands that the engine refused."""
    latency_s: Spread | None = None
    """From publication to arrival, from call or goal to its end, s."""
    age_s: Spread | None = None
    """Age of samples as they arrived, s, if they are stamped."""
    outcomes: dict[str, int] = {}
    """Outcomes of reliable samples, as reported to their publishers."""
    transmitted_bytes: int = 0
    """Bytes given to the links, with headers and repetitions."""
    airtime_s: float = 0.0
    """Its share of the airtime in the recorded time, s."""


class NodeFigures(msgspec.Struct, kw_only=True):
    """Figures of one node's links."""

    node: int
    """Its address."""
    epochs: int
    """Number of recorded boot epochs."""
    frames: int = 0
    """Frames sent."""
    frame_bytes: int = 0
    """Their bytes."""
    ledger_bytes: int | None = None
    """Sum of the ledgers of all boot epochs; None: the recording has none."""
    covered_bytes: int | None = None
    """Bytes of the frames before the last ledger: less than all in a recording that ends early."""
    ledger_is_exact: bool | None = None
    """Whether the two are equal."""
    airtime_s: float = 0.0
    """Airtime of the frames, s."""
    utilisation: float = 0.0
    """Share of the time, 0…1."""
    outcomes: dict[str, int] = {}
    """Number of transmissions by outcome."""
    by_cause: dict[str, int] = {}
    """Bytes of the ledger by cause."""


class Figures(msgspec.Struct, kw_only=True):
    """All figures of a recording."""

    files: list[str]
    """The recordings."""
    began_utc_ns: int
    """First message, ns since 1970."""
    duration_s: float
    """To the last message, s."""
    utilisation: float
    """Airtime of all recorded nodes together, as a share of the time."""
    streams: list[StreamFigures]
    """The streams by id."""
    nodes: list[NodeFigures]
    """The nodes by address."""
    links: list[LinkFigures]
    """The links by sender and receiver."""
    handled: list[Handled] = []
    """Executed or refused remote commands, and frames that did not open."""
    notes: list[str]
    """Remarks for the reader, one line each."""
    verdict: list[str] = []
    """Conclusions, one line each."""


def figures_of(facts: Facts) -> Figures:
    """Compute the figures."""
    match(facts)
    nodes = [_node(facts, node) for node in facts.nodes]
    figures = Figures(
        files=facts.files,
        began_utc_ns=facts.began_ns,
        duration_s=facts.duration_s,
        utilisation=sum(each.utilisation for each in nodes),
        streams=_streams(facts),
        nodes=nodes,
        links=links_of(facts),
        handled=facts.handled,
        notes=_notes(facts, nodes),
    )
    figures.verdict = _verdict(figures)
    return figures


def _streams(facts: Facts) -> list[StreamFigures]:
    latencies: Rows[Number] = Rows(Number)
    for each in itertools.chain(facts.deliveries, facts.answers):
        took_s = (each.at_ns - each.begun_ns) / 1e9
        latencies.append(Number(each.stream_id, 0, 0, took_s, each.at_ns))
    latencies_s, ages_s = spreads_of(latencies), spreads_of(facts.ages)
    left = Counter(left_out(facts))
    found: dict[int, StreamFigures] = {}
    for stream_id, stream in sorted(facts.streams.items()):
        counts = facts.counts.get(stream_id, Counts())
        thinned = {node: left[node, stream_id] for node in counts.samples}
        expected = sum(
            (number - thinned[node]) * _hearers(facts, stream, node)
            for node, number in counts.samples.items()
        )
        latency_s = latencies_s.get((stream_id, 0, 0))
        found[stream_id] = StreamFigures(
            stream_id=stream_id,
            name=stream.name,
            kind=_kind(stream),
            published=counts.published + counts.asked,
            expected=expected + counts.asked,
            thinned=sum(thinned.values()),
            delivered=0 if latency_s is None else latency_s.count,
            arrived=counts.arrived,
            failed=counts.failed,
            refused=counts.refused,
            latency_s=latency_s,
            age_s=ages_s.get((stream_id, 0, 0)),
            outcomes=counts.outcomes,
        )
    for _, ledger in sorted(facts.ledgers.items()):
        per_byte_s = ledger.airtime_s / ledger.bytes if ledger.bytes else 0.0
        for row in ledger.rows:
            if row.stream_id != NO_STREAM and row.stream_id in found:
                found[row.stream_id].transmitted_bytes += row.transmitted_bytes
                own_s = row.airtime_s
                found[row.stream_id].airtime_s += (
                    row.transmitted_bytes * per_byte_s if own_s is None else own_s
                )
    return list(found.values())


def _hearers(facts: Facts, stream: Stream, publisher: int) -> int:
    """Return the number of recorded nodes at which a sample should arrive."""
    return sum(node != publisher and stream.may_subscribe(node) for node in facts.tables)


def _kind(stream: Stream) -> str:
    if isinstance(stream.spec, ServiceSpec):
        return "service"
    return "action" if isinstance(stream.spec, ActionSpec) else "topic"


def _node(facts: Facts, node: int) -> NodeFigures:
    sent = facts.transmitted.get(node, Transmitted())
    found = NodeFigures(
        node=node,
        epochs=facts.epochs.get(node, 0),
        frames=sent.frames,
        frame_bytes=sent.size_bytes,
        airtime_s=sent.airtime_s,
        outcomes=dict(facts.report_counts.get(node, {})),
    )
    for (whose, _), ledger in facts.ledgers.items():
        if whose == node:
            rows = sum(row.transmitted_bytes for row in ledger.rows)
            found.ledger_bytes = (found.ledger_bytes or 0) + rows
            for row in ledger.rows:
                known = found.by_cause.get(row.cause, 0)
                found.by_cause[row.cause] = known + row.transmitted_bytes
    if found.ledger_bytes is not None and found.epochs:
        found.covered_bytes = facts.covered_bytes.get(node, found.frame_bytes)
        found.ledger_is_exact = found.ledger_bytes == found.covered_bytes
    if facts.duration_s > 0:
        found.utilisation = found.airtime_s / facts.duration_s
    return found


def _notes(facts: Facts, nodes: list[NodeFigures]) -> list[str]:
    notes = [f"{file} ends early: {reason}" for file, reason in facts.damage.items()]
    notes += [
        f"{file} was recorded by zacoustic {maker}, and is read by {program()}"
        for file, maker in facts.programs.items()
        if maker not in ("", program())
    ]
    notes += facts.faults
    if facts.unread:
        notes.append(f"calls of engines that this version cannot read, left out: {facts.unread}")
    others = sorted(facts.sources - facts.tables.keys() - {0})
    if others and facts.tables:
        names = ", ".join(str(node) for node in others)
        notes.append(
            f"node {names} is not recorded: what it published is not known, only what arrived"
        )
    if not facts.tables:
        notes.append("no engine was recorded: what was published is not known, only what arrived")
    notes += [
        f"node {each.node}: the ledger sums to {each.ledger_bytes} bytes, the frames to "
        f"{each.covered_bytes}: something of it is not in the recording"
        for each in nodes
        if each.ledger_is_exact is False
    ]
    return notes


def _verdict(figures: Figures) -> list[str]:
    """Return the conclusions: known losses first, then samples left out on purpose."""
    expected = sum(each.expected for each in figures.streams)
    delivered = sum(each.delivered for each in figures.streams)
    if not expected:
        arrived = sum(each.arrived for each in figures.streams)
        return [f"{arrived} samples arrived; what did not is not known from these recordings"]
    short = [each for each in figures.streams if each.delivered < each.expected]
    short.sort(key=lambda each: each.delivered / each.expected)
    lines = [f"everything arrived: {delivered} of {expected} samples, calls and goals"]
    if short:
        lines = [f"{expected - delivered} of {expected} did not arrive: {_named(short)}"]
    refused = sum(each.refused for each in figures.streams)
    if refused:
        whose = ", ".join(each.name for each in figures.streams if each.refused)
        lines.append(f"{refused} were refused and never sent: {whose}")
    lines += [
        f"{each.name}: {each.thinned} of {each.published} left out on purpose by min_interval_s"
        for each in figures.streams
        if each.thinned
    ]
    worst = max((link.loss for link in figures.links if link.loss is not None), default=None)
    if worst is not None:
        lines.append(f"of the frames {worst:.0%} were lost on the worst link")
    return lines


def _named(streams: list[StreamFigures]) -> str:
    words = [
        f"{each.name} {each.expected - each.delivered} of {each.expected}"
        for each in streams[:_NAMED]
    ]
    more = len(streams) - _NAMED
    return ", ".join(words) + (f", and {more} more streams" if more > 0 else "")
