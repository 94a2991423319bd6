"""Text for people of what a check has found."""

from zacoustic.tools.columns import align
from zacoustic.tools.recordings.checking import Verdict


def as_text(verdict: Verdict) -> str:
    """Return a table of the lives, and what differs."""
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
        for life in verdict.lives
    ]
    lines = [align(header, rows, right=header[:-1])]
    lines += [
        f"node {life.node}, epoch {life.epoch}: {life.difference}"
        for life in verdict.lives
        if life.difference
    ]
    if verdict.damage:
        lines.append(f"{verdict.file} ends early: {verdict.damage}")
    if verdict.is_same:
        lines.append("every frame, event, timer and ledger is the same, byte for byte")
    return "\n".join(lines)
