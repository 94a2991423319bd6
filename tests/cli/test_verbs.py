"""A verb is a declaration: what the runner makes of it, and what each of ours promises by types."""

import argparse
import asyncio
import os
import signal
import threading
from typing import Any

import pytest

from zacoustic.app.cli.support.rows import (
    OBJECT_PER_LINE,
    flag,
    node_address,
    option,
    real,
    repeated,
    seconds,
    whole,
    word,
)
from zacoustic.app.cli.support.verb import Verb
from zacoustic.app.cli.tree import built_in
from zacoustic.app.cli.verbs import VERBS
from zacoustic.errors import ConfigError


class Shared(Verb):
    """A verb with arguments that others share."""

    connect: list[str] | None = repeated("ENDPOINT", "where", None)
    node: int | None = node_address("which")


class Dredge(Shared):
    """Dig: a ditch, or
    a trench.

    it takes its time

    Example:
      zacoustic dredge 3 --depth-m 2
    """

    place: str = word("PLACE", "where to dig")
    depth_m: float = real("M", "how deep", 1.5, least=0.5, most=30.0)
    rest: float | None = seconds("pause, s", most=60.0)
    turns: int = whole("N", "how often (default: thrice)", 3, least=1)
    for_: str = option("WHO", "for whom", "us")
    soft: bool = flag("in sand", either="ground")
    hard: bool = flag("in rock", either="ground")
    node: int | None = node_address("which of them")
    json: bool = flag(OBJECT_PER_LINE)

    async def work(self) -> int:
        """Dig."""
        self.note(f"{self.place} {self.depth_m:g} {self.turns} {self.for_} {self.connect}")
        return 7 if self.hard else 0


def parser_of(verb: Verb) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="zacoustic dredge", allow_abbrev=False)
    verb.add_arguments(parser)
    return parser


def run(*words: str) -> int:
    verb = Dredge()
    return verb.run(parser_of(verb).parse_args(words))


def test_the_docstring_is_the_help() -> None:
    assert Dredge.summary == "dig: a ditch, or a trench"
    assert Dredge.epilog == ("it takes its time\n\nexample:\n  zacoustic dredge 3 --depth-m 2")


def test_own_arguments_come_before_shared_ones_and_json_is_the_last() -> None:
    names = [*Dredge().rows()]
    assert names == [
        "place", "depth_m", "rest", "turns", "for_", "soft", "hard", "node", "connect", "json",
    ]  # fmt: skip
    helped = " ".join(parser_of(Dredge()).format_help().split())
    for text in (
        "--depth-m M how deep (default: 1.5)", "--for WHO for whom (default: us)",
        "how often (default: thrice)", "--node N which of them", "where; may be given again",
        "[--soft | --hard]",
    ):  # fmt: skip
        assert text in helped


def test_work_has_the_values_and_its_result_is_the_exit_code(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("reef", "--depth-m", "2") == 0
    assert run("reef", "--hard", "--for", "them", "--connect", "a", "--connect", "b") == 7
    assert capsys.readouterr().err.splitlines() == [
        "zacoustic dredge: reef 2 3 us None", "zacoustic dredge: reef 1.5 3 them ['a', 'b']",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--depth-m", "0"], "--depth-m 0; allowed: 0.5..30"),
        (["--depth-m", "nan"], "--depth-m nan; allowed: 0.5..30"),
        (["--rest", "0"], "--rest 0; allowed: above 0, 1e-06..60 s"),
        (["--rest", "61"], "--rest 61; allowed: above 0, 1e-06..60 s"),
        (["--turns", "0"], "--turns 0; allowed: 1..1000000000"),
        (["--node", "255"], "--node 255; allowed: 1..254"),
    ],
)
def test_a_value_outside_its_limits_is_refused_before_any_work(
    words: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match=text.replace(".", r"\.")):
        run("reef", *words)
    assert capsys.readouterr().err == ""


class Anchored(Verb):
    """Wait: until somebody stops it."""

    runs_on = True

    async def work(self) -> int:
        """Wait."""
        threading.Timer(0, os.kill, (os.getpid(), signal.SIGTERM)).start()
        await asyncio.get_running_loop().create_future()
        return 7


def test_a_signal_ends_a_verb_that_runs_on_with_exit_code_0() -> None:
    verb = Anchored()
    assert verb.run(parser_of(verb).parse_args([])) == 0


def promised(verb: Verb, name: str) -> Any:
    """Return the annotation of an argument."""
    found = (vars(each).get("__annotations__", {}) for each in type(verb).__mro__)
    return next(each[name] for each in found if name in each)


def given(action: argparse.Action, *, is_required: bool) -> Any:
    """Return the type of the values that the parser gives."""
    if isinstance(action, argparse._StoreTrueAction):
        return bool
    one = {"_node": tuple[int, str]}.get(getattr(action.type, "__name__", ""), action.type or str)
    is_list = isinstance(action, argparse._AppendAction) or action.nargs in ("+", "*")
    value: Any = list[one] if is_list else one  # type: ignore[valid-type]
    may_lack = action.default is None and not is_required
    if not action.option_strings:
        may_lack = action.default is None and action.nargs == "?"
    return value | None if may_lack else value


@pytest.mark.parametrize("words", VERBS)
def test_each_argument_has_the_type_of_its_annotation(words: str) -> None:
    verb = built_in(VERBS[words])
    assert isinstance(verb, Verb)
    actions = {each.dest: each for each in parser_of(verb)._actions}
    wrong = []
    for name, row in verb.rows().items():
        promise, value = promised(verb, name), given(actions[name], is_required=row.required)
        # If one of two is required, each of them may lack.
        if promise not in (value, value | None if row.either else value):
            wrong.append((name, promise, value))
    assert not wrong
