"""The command line itself: how verbs are found, and what becomes of errors."""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from zacoustic.app import cli
from zacoustic.app.cli import BUILT_IN, complete_parser, main
from zacoustic.command import Command
from zacoustic.errors import (
    CallTimeoutError,
    ConfigError,
    LinkUnavailableError,
    ServiceError,
    ZacousticError,
)
from zacoustic.link import registry

EXAMPLE_CONFIG = '{ plugins: { acoustic: { address: 1, streams: [ { id: 1, topic: "hello" } ] } } }'


def run(*arguments: str, text: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "zacoustic", *arguments],
        input=text,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


class Failing(Command):
    """Stands for a verb, and raises."""

    name = "links"
    summary = "fails"

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        pass

    def run(self, arguments: argparse.Namespace) -> int:
        raise self.error


@pytest.fixture
def raising(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], int]:
    def call(error: BaseException) -> int:
        monkeypatch.setattr(cli, "_built_in", lambda name: Failing(error))
        return main(["links"])

    return call


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError("address: 300", hint="1..254"), 2),
        (ZacousticError("no\nluck"), 1),
        (ServiceError("the handler failed"), 1),
        (CallTimeoutError("no answer within 3 s"), 3),
        (TimeoutError(), 3),
        (KeyboardInterrupt(), 130),
        (BrokenPipeError(), 1),
        (ModuleNotFoundError("No module named 'rich'", name="rich"), 1),
    ],
)
def test_each_kind_of_error_has_its_exit_code_and_one_line_at_most(
    error: BaseException,
    code: int,
    raising: Callable[[BaseException], int],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert raising(error) == code
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.count("\n") <= 1
    assert "Traceback" not in written.err


def test_an_error_names_the_verb_and_says_what_to_do(
    raising: Callable[[BaseException], int], capsys: pytest.CaptureFixture[str]
) -> None:
    raising(ConfigError("address: 300", hint="1..254"))
    assert capsys.readouterr().err == "zacoustic links: address: 300 (1..254)\n"


def test_a_fault_of_the_program_is_not_hidden(raising: Callable[[BaseException], int]) -> None:
    with pytest.raises(ZeroDivisionError):
        raising(ZeroDivisionError())
    with pytest.raises(ModuleNotFoundError):
        raising(ModuleNotFoundError("gone", name="zacoustic.app.tools.gone"))


def test_an_unknown_verb_is_one_line_with_a_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["chekc"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("zacoustic chekc: no such verb")
    assert 'did you mean "check"?' in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("arguments", [["check"], ["check", "a", "b"], ["decode", "--bogus"], []])
def test_wrong_arguments_are_one_line_and_exit_code_2(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.count("\n") == 1
    assert "--help" in written.err


def test_help_lists_every_verb_and_starts_no_zenoh() -> None:
    program = (
        "import sys; from zacoustic.app.cli import main; code = main(['--help']);"
        "print('zenoh' in sys.modules, 'rich' in sys.modules, file=sys.stderr); sys.exit(code)"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert process.returncode == 0
    assert process.stderr.split() == ["False", "False"]
    for verb in (*BUILT_IN, "emulate", "medium"):
        assert f"\n    {verb} " in process.stdout


@pytest.mark.parametrize("verb", BUILT_IN)
def test_the_help_of_every_verb_has_an_example(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([verb, "--help"]) == 0
    helped = capsys.readouterr().out
    assert "example" in helped
    assert f"zacoustic {verb}" in helped.partition("example")[2]


def test_every_verb_that_prints_results_has_json() -> None:
    def lacking(parser: argparse.ArgumentParser) -> list[str]:
        below = [each for each in parser._actions if isinstance(each, argparse._SubParsersAction)]
        if below:
            return [name for each in below[0].choices.values() for name in lacking(each)]
        has_json = any("--json" in each.option_strings for each in parser._actions)
        return [] if has_json else [parser.prog]

    assert lacking(complete_parser()) == ["zacoustic completion"]


@pytest.mark.parametrize(
    ("module", "advice"),
    [
        ("rich", "in zacoustic's checkout: pip install '.[terminal]'"),
        ("nicegui.ui", "in zacoustic's checkout: pip install '.[console]'"),
        ("serial", "pip install pyserial"),
        ("x", "pip install x"),
    ],
)
def test_absent_library_names_what_brings_it(
    module: str,
    advice: str,
    raising: Callable[[BaseException], int],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert raising(ModuleNotFoundError("absent", name=module)) == 1
    assert capsys.readouterr().err == (
        f"zacoustic links: needs {module}, which is not installed ({advice})\n"
    )


class Echo(Command):
    """Says what it was called with."""

    summary = "says 100% of it"

    def __init__(self, name: str) -> None:
        self.name = name  # type: ignore[misc]

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--text", default="nothing")
        parser.add_argument("more", nargs="*")

    def run(self, arguments: argparse.Namespace) -> int:
        print(self.name, arguments.text, *arguments.more)
        return 3


class Installed(Mapping[str, Command]):
    """Stands for what is installed, and notes what is imported."""

    def __init__(self) -> None:
        gone = LinkUnavailableError("command 'emulate.c' needs serial")
        self.imported: list[str] = []
        self._commands = {name: Echo(name) for name in ("emulate.a", "emulate.b", "emulator")}
        self._broken = {"emulate.c": registry.UnavailableCommand("emulate.c", gone)}

    def __getitem__(self, name: str) -> Command:
        self.imported.append(name)
        return self._commands.get(name) or self._broken[name]

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self._commands, *self._broken}))

    def __len__(self) -> int:
        return len(self._commands) + len(self._broken)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Installed:
    commands = Installed()
    monkeypatch.setattr(registry, "commands", lambda: commands)
    return commands


@pytest.mark.parametrize("flags", [[], ["-v"]])
def test_a_shared_verb_runs_the_sub_verb_that_is_called_and_imports_no_other(
    flags: list[str], installed: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*flags, "emulate", "b", "--text", "a", "c"]) == 3
    assert capsys.readouterr().out == "emulate.b a c\n"
    assert installed.imported == ["emulate.b"]
    assert main(["emulator"]) == 3
    assert capsys.readouterr().out == "emulator nothing\n"


def test_the_list_of_verbs_has_a_shared_one_once_and_imports_none_of_its_sub_verbs(
    installed: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--help"]) == 0
    helped = capsys.readouterr().out
    assert helped.count("\n    emulate ") == 1
    assert "a, b, c: see zacoustic emulate --help" in helped
    assert installed.imported == ["emulator"]


def test_the_help_of_a_shared_verb_lists_its_sub_verbs_the_broken_one_too(
    installed: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["emulate", "--help"]) == 0
    helped = capsys.readouterr().out
    for line in ("\n    a ", "\n    b ", "\n    c ", "says 100% of it", "not available: "):
        assert line in helped
    assert "example:\n  zacoustic emulate a --help" in helped


@pytest.mark.parametrize(
    ("arguments", "code", "error"),
    [
        (["emulate"], 2, "zacoustic emulate: the following arguments are required: VERB"),
        (["emulate", "aa"], 2, "zacoustic emulate aa: no such verb; there are: a, b, c"),
        (["emulate", "a", "--bogus"], 2, "zacoustic emulate a: unrecognized arguments: --bogus"),
        (["emulate", "c", "--port", "7"], 1, "zacoustic emulate c: command 'emulate.c' needs"),
        (["emulate.a"], 2, "zacoustic emulate.a: no such verb"),
    ],
)
@pytest.mark.usefixtures("installed")
def test_a_sub_verb_that_cannot_be_called_is_one_line(
    arguments: list[str], code: int, error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == code
    written = capsys.readouterr()
    assert written.out == ""
    assert written.err.count("\n") == 1
    assert written.err.startswith(error)


@pytest.mark.parametrize("name", [name for name in registry.commands() if "." in name])
def test_the_help_of_every_sub_verb_has_an_example(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    verb, _, sub_verb = name.partition(".")
    assert main([verb, sub_verb, "--help"]) == 0
    helped = capsys.readouterr().out
    assert f"zacoustic {verb} {sub_verb}" in helped.partition("example")[2]


def test_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("zacoustic 0.")


def test_a_verb_of_a_link_package_that_cannot_be_imported_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    error = LinkUnavailableError("command 'emulate' needs serial", hint="pip install x[emulate]")
    broken = registry.UnavailableCommand("emulate", error)
    monkeypatch.setattr(registry, "commands", lambda: {"emulate": broken})
    assert main(["emulate", "--port", "7"]) == 1
    expected = "zacoustic emulate: command 'emulate' needs serial (pip install x[emulate])\n"
    assert capsys.readouterr().err == expected
    assert main(["--help"]) == 0
    assert "not available" in " ".join(capsys.readouterr().out.split())


def test_a_reader_that_has_gone_is_no_error(tmp_path: Path) -> None:
    config = tmp_path / "fleet.json5"
    config.write_text(EXAMPLE_CONFIG, encoding="utf-8")
    reading, writing = os.pipe()
    os.close(reading)
    try:
        process = subprocess.run(
            [sys.executable, "-m", "zacoustic", "check", str(config)],
            stdout=writing, stderr=subprocess.PIPE, text=True, check=False, timeout=60,
        )  # fmt: skip
    finally:
        os.close(writing)
    assert process.stderr == ""
    assert process.returncode == 1


def test_the_module_is_the_program() -> None:
    process = run("links", "--json")
    assert process.returncode == 0
    assert process.stderr == ""
    assert '"name": "sim"' in process.stdout
