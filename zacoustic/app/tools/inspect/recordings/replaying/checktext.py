"""The results of a check, or of a replay with another configuration, as text for people."""

from collections.abc import Sequence

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.inspect.recordings.replaying.checking import Verdict
from zacoustic.app.tools.inspect.recordings.replaying.otherwise import Otherwise


def as_text(verdict: Verdict) -> str:
    """Return a table of the boot epochs, and the differences."""
    header = ("node", "epoch", "s", "calls", "frames", "bytes", "ledger", "deliveries", "")
    rows = [
        (
            str(life.node),
            str(life.epoch),
            f"{life.duration_s:.1f}",
            str(life.calls),
            str(life.frames),
            str(life.frame_bytes),
            str(life.ledger_bytes),
            str(life.deliveries),
            "DIFFERS" if life.difference else "the same",
        )
        for life in verdict.epochs
    ]
    lines = [align(header, rows, right=header[:-1])]
    lines += [
        f"node {life.node}, epoch {life.epoch}: {life.difference}"
        for life in verdict.epochs
        if life.difference
    ]
    if verdict.damage:
        lines.append(f"{verdict.file} ends early: {verdict.damage}")
    if verdict.is_same:
        lines.append("every frame, event, timer and ledger is the same, byte for byte")
    return "\n".join(lines)


def otherwise_as_text(epochs: Sequence[Otherwise]) -> str:
    """Return tables of then and now, and the first frame that differs."""
    header = ("node", "epoch", "frames then", "now", "the same", "bytes then", "now")
    rows = [
        (
            str(life.node),
            str(life.epoch),
            str(life.frames_then),
            str(life.frames_now),
            str(life.same_frames),
            str(life.bytes_then),
            str(life.bytes_now),
        )
        for life in epochs
    ]
    lines = [align(header, rows, right=header)]
    for life in epochs:
        who = f"node {life.node}, epoch {life.epoch}"
        names = sorted({*life.samples_then, *life.samples_now})
        samples = [
            f"{name} {life.samples_then.get(name, 0)} → {life.samples_now.get(name, 0)}"
            for name in names
        ]
        lines.append(f"{who}: samples that arrived: {', '.join(samples) or 'none'}")
        if life.differing:
            lines.append(f"{who}: streams defined in another way: {', '.join(life.differing)}")
        if life.refused:
            said = ", ".join(f"{number} {name}" for name, number in life.refused.items())
            lines.append(f"{who}: commands refused that were not: {said}")
        if life.first_difference:
            lines.append(f"{who}: the first other frame {life.first_difference}")
    if all(not life.first_difference for life in epochs):
        lines.append("every frame is the same, byte for byte")
    return "\n".join(lines)
