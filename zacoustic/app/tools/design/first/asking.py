"""Questions about each topic, on a terminal: keep it, leave it out, or change its interval."""

import sys
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.design.first.drafting import TopicDraft
from zacoustic.core.base.clock import LONGEST_S, SHORTEST_S
from zacoustic.text.safetext import one_line

_HELP: Final = "Enter: as proposed; n: leave it out; a number: seconds between two samples"


def ask_about(
    drafts: Sequence[TopicDraft], *, ask: Callable[[str], str] | None = None
) -> list[TopicDraft]:
    """Ask about each topic.

    Args:
        drafts: The proposals.
        ask: Shows a question and returns the answer; None: on the terminal. At its end the rest is
            kept as proposed.

    Returns:
        What is kept, as the user wants it.
    """
    question = _ask if ask is None else ask
    kept: list[TopicDraft] = []
    for index, draft in enumerate(drafts):
        try:
            answered = _answered(draft, question, is_first=index == 0)
        except EOFError:
            return [*kept, *drafts[index:]]
        if answered is not None:
            kept.append(answered)
    return kept


def _answered(draft: TopicDraft, ask: Callable[[str], str], *, is_first: bool) -> TopicDraft | None:
    """Return what becomes of a draft; None: it is left out."""
    told = f"{_HELP}\n" if is_first else ""
    while True:
        answer = ask(f"{told}{one_line(_proposal(draft))}: ").strip().lower()
        if answer in ("", "y", "yes"):
            return draft
        if answer in ("n", "no"):
            return None
        try:
            interval_s = float(answer.removesuffix("s"))
        except ValueError:
            interval_s = 0.0
        if SHORTEST_S <= interval_s <= LONGEST_S:
            return msgspec.structs.replace(draft, interval_s=interval_s)
        told = f"{_HELP}\n"


def _proposal(draft: TopicDraft) -> str:
    rate = "as it comes" if draft.interval_s is None else f"every {draft.interval_s:g} s"
    how = ", reliable" if draft.is_reliable else ""
    seen = draft.seen
    what = (
        f"{seen.rate_hz:.3g}/s, {seen.largest_bytes} B" if seen.samples else "from the other side"
    )
    return f"{draft.name} ({what}): {rate}, {draft.priority}{how}"


def _ask(question: str) -> str:
    """Show a question on standard error: standard output may be the file."""
    sys.stderr.write(question)
    sys.stderr.flush()
    answer = sys.stdin.readline()
    if not answer:
        raise EOFError
    return answer
