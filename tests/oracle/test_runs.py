"""A rebuild changes no byte of what is transmitted, and no instant."""

from collections.abc import Callable

from tests.oracle.runs import NAMES, ONE_OF_EACH, kept, run


def test_every_run_is_what_it_was(sized: Callable[..., int]) -> None:
    before = kept()
    assert tuple(before) == NAMES
    for name in NAMES[: sized(len(NAMES), share=0)] or ONE_OF_EACH:
        assert not before[name].difference(run(name)), f"python -m tests.oracle {name}"


def test_runs_are_no_empty_ones() -> None:
    marks = kept()
    assert sum(each.frames for each in marks.values()) > 30_000
    assert sum(each.frames < 10 for each in marks.values()) < 10
    assert len({each.digests[-1] for each in marks.values()}) == len(marks)
