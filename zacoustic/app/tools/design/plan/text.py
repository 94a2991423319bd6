"""The report of `zacoustic.app.tools.design.plan` for people."""

import json
from collections.abc import Iterator, Sequence

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.design.plan.agreement import AgreementPlan
from zacoustic.app.tools.design.plan.report import NodePlan, PlanReport, StreamPlan
from zacoustic.app.tools.design.plan.slots import SchedulePlan
from zacoustic.text.safetext import one_line

_STREAMS = (
    "id", "stream", "per hour", "airtime/h", "of the time", "of all", "goes", "refused", "expected",
    "worst", "bound",
)  # fmt: skip
_NODES = ("node", "transmits", "relayed", "energy/day")
_MOST_NODES = 12
_MOST_RANGES = 3


def as_text(report: PlanReport) -> str:
    """Return the report as lines."""
    return "\n".join(_lines(report))


def _lines(report: PlanReport) -> Iterator[str]:
    rows = [_stream_cells(each) for each in report.streams]
    yield align(_STREAMS, rows, right=[name for name in _STREAMS if name != "stream"])
    yield ""
    yield from _node_lines(report.nodes)
    yield ""
    yield (
        f"{report.file}: {report.utilisation:.1%} of the time there is sound "
        f"(±{report.confidence:.1%}), "
        f"{report.frames_per_h:.0f} frames an hour ({report.profile}, "
        f"{report.transmit_w:.3g} W while it transmits)"
    )
    yield f"simulated: {_span(report.hours)} of virtual time, one seed; ± is for 95 of 100 seeds"
    if report.links:
        shares = (
            f"{each.name} {each.utilisation:.1%} ({each.profile})"
            + ("" if each.paid_per_day is None else f", {each.paid_per_day:.4g} a day")
            for each in report.links
        )
        yield one_line(f"by link: {', '.join(shares)}")
    if report.fits:
        yield "it fits"
    else:
        yield f"it does not fit: all of it would take {report.demand:.0%} of the time"
        yield from (one_line(f"  {each}") for each in report.misfits)
        for change in report.changes:
            yield one_line(f"it would fit with: {change.what} ({change.demand:.0%} of the time)")
        if not report.changes:
            yield "no single change that was tried makes it fit"
    if report.agreement is not None:
        yield _agreement_line(report.agreement)
    yield from (one_line(f"note: {each}") for each in report.notes)
    if report.schedule is not None:
        yield ""
        yield from _schedule_lines(report.schedule)


def _schedule_lines(schedule: SchedulePlan) -> Iterator[str]:
    yield (
        f"schedule: a cycle of {schedule.cycle_s:.1f} s, {schedule.guards_s:.1f} s of it guards "
        f"({schedule.uniform_s:.1f} s with the longest guard for all); for each node's config:"
    )
    settings = [(key, value) for key, value in schedule.access.items() if key != "slots"]
    yield "access: {"
    yield "  " + " ".join(f"{key}: {json.dumps(value)}," for key, value in settings)
    yield "  slots: ["
    for slot in schedule.access["slots"]:
        yield (
            "    { " + ", ".join(f"{key}: {json.dumps(each)}" for key, each in slot.items()) + " },"
        )
    yield "  ],"
    yield "}"


def _agreement_line(found: AgreementPlan) -> str:
    shares = ", ".join(
        f'"{method}" {share:.0%} of the bytes of the first {found.compared_s[method] / 60:.0f} min'
        for method, share in found.share.items()
    )
    advice = (
        "as the file has it"
        if found.method == found.proposed
        else f'agreement: "{found.proposed}" is better'
    )
    return f"agreement takes with {shares}: {advice}"


def _stream_cells(row: StreamPlan) -> tuple[str, ...]:
    return (
        str(row.stream_id),
        row.name,
        f"{row.per_h:.0f}",
        f"{row.airtime_s_per_h:.0f} s",
        f"{row.utilisation:.1%}",
        f"{row.share:.0%}",
        f"{row.went:.0%}",
        f"{row.refused:.0%}" if row.refused else "",
        _seconds(row.expected_s),
        _seconds(row.worst_s),
        _seconds(row.bound_s),
    )


def _node_lines(nodes: Sequence[NodePlan]) -> Iterator[str]:
    left_out = () if any(each.relayed for each in nodes) else ("relayed",)
    heads = [each for each in _NODES if each not in left_out]
    rows = [
        tuple(cell for head, cell in zip(_NODES, row, strict=True) if head in heads)
        for row in _node_rows(nodes)
    ]
    yield align(heads, rows, right=heads)


def _node_rows(nodes: Sequence[NodePlan]) -> list[tuple[str, ...]]:
    """Return a row for each node; in a large fleet equal nodes share one, the largest first."""
    if len(nodes) <= _MOST_NODES:
        return [_node_cells(str(each.address), [each]) for each in nodes]
    equal: dict[str, list[NodePlan]] = {}
    for each in sorted(nodes, key=lambda node: -node.utilisation):
        equal.setdefault(f"{each.utilisation:.1%}", []).append(each)
    rows = [
        _node_cells(_ranges(sorted(each.address for each in group)), group)
        for group in equal.values()
    ]
    if len(rows) <= _MOST_NODES:
        return rows
    others = sum(map(len, list(equal.values())[_MOST_NODES:]))
    return [*rows[:_MOST_NODES], (f"{others} others", "less", "", "")]


def _node_cells(name: str, group: Sequence[NodePlan]) -> tuple[str, ...]:
    energy_wh = sum(each.energy_wh_per_day for each in group) / len(group)
    relayed = sum(each.relayed for each in group) / len(group)
    return (
        name,
        f"{group[0].utilisation:.1%}",
        f"{relayed:.1%}" if relayed else "",
        f"{energy_wh:.1f} Wh",
    )


def _ranges(addresses: list[int]) -> str:
    """Return a sorted list of addresses as ranges; a long list is cut and has its length."""
    runs: list[list[int]] = []
    for each in addresses:
        if runs and runs[-1][-1] == each - 1:
            runs[-1][1:] = [each]
        else:
            runs.append([each])
    told = ", ".join("–".join(map(str, run)) for run in runs[:_MOST_RANGES])
    return told if len(runs) <= _MOST_RANGES else f"{told}, … ({len(addresses)})"


def _span(hours: float) -> str:
    return f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.0f} min"


def _seconds(duration_s: float | None) -> str:
    return "" if duration_s is None else f"{duration_s:.1f} s"
