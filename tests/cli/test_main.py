"""The command line itself: how verbs are found, and what becomes of errors."""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from zacoustic.app.cli import complete_parser, main, tree
from zacoustic.app.cli.verbs import ALIASES, HEADINGS, VERBS
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
        monkeypatch.setattr(tree, "built_in", lambda place: Failing(error))
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
    assert 'did you mean "config check"?' in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [["config", "check"], ["config", "check", "a", "b"], ["decode", "--bogus"], ["config"], []],
)
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
    for words in HEADINGS.values():
        for word in words:
            assert f"\n  {word} " in process.stdout
    assert max(map(len, process.stdout.splitlines())) <= 80


def test_every_verb_has_a_heading_and_old_words_are_not_in_the_help(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--help"]) == 0
    helped = capsys.readouterr().out
    headed = {word for words in HEADINGS.values() for word in words}
    assert headed == {verb.split()[0] for verb in VERBS}
    assert "of link packages" not in helped
    assert not [old for old in ALIASES if f"\n  {old} " in helped]


@pytest.mark.parametrize("verb", VERBS)
def test_the_help_of_every_verb_has_an_example(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*verb.split(), "--help"]) == 0
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
    assert main([*flags, "run", "modems", "b", "--text", "a", "c"]) == 3
    assert capsys.readouterr().out == "emulate.b a c\n"
    assert installed.imported == ["emulate.b"]
    assert main(["emulator"]) == 3
    assert capsys.readouterr().out == "emulator nothing\n"


def test_the_list_of_verbs_has_a_shared_one_once_and_imports_none_of_its_sub_verbs(
    installed: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--help"]) == 0
    helped = capsys.readouterr().out
    assert "of link packages:\n  emulator    says 100% of it" in helped
    assert installed.imported == ["emulator"]
    assert main(["run", "--help"]) == 0
    assert "modems    a, b, c: emulated modems" in capsys.readouterr().out
    assert installed.imported == ["emulator"]


def test_the_help_of_a_shared_verb_lists_its_sub_verbs_the_broken_one_too(
    installed: Installed, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "modems", "--help"]) == 0
    helped = capsys.readouterr().out
    for line in ("\n    a ", "\n    b ", "\n    c ", "says 100% of it", "not available: "):
        assert line in helped
    assert "example:\n  zacoustic run modems a --help" in helped


@pytest.mark.parametrize(
    ("arguments", "code", "error"),
    [
        (["run", "modems"], 2, "zacoustic run modems: the following arguments are required: VERB"),
        (["run", "modems", "aa"], 2, "zacoustic run modems aa: no such verb; there are: a, b, c"),
        (
            ["run", "modems", "a", "--bogus"],
            2,
            "zacoustic run modems a: unrecognized arguments: --bogus",
        ),
        (["emulate", "c", "--port", "7"], 1, "zacoustic run modems c: command 'emulate.c' needs"),
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
    words, _ = tree.renamed(name.split("."))
    assert main([*words, "--help"]) == 0
    helped = capsys.readouterr().out
    assert f"zacoustic {' '.join(words)}" in helped.partition("example")[2]


def test_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("zacoustic 0.")


def test_a_verb_of_a_link_package_that_cannot_be_imported_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    error = LinkUnavailableError("command 'dredge' needs serial", hint="pip install x[emulate]")
    broken = registry.UnavailableCommand("dredge", error)
    monkeypatch.setattr(registry, "commands", lambda: {"dredge": broken})
    assert main(["dredge", "--port", "7"]) == 1
    expected = "zacoustic dredge: command 'dredge' needs serial (pip install x[emulate])\n"
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
            [sys.executable, "-m", "zacoustic", "config", "check", str(config)],
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


@pytest.mark.parametrize("old", ALIASES)
def test_old_words_take_the_arguments_of_the_new_ones(
    old: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are the same verb: options, output and exit codes are one parser's and one `run`."""
    assert main([*old.split(), "--help"]) == 0
    helped = capsys.readouterr()
    assert main([*ALIASES[old].split(), "--help"]) == 0
    assert capsys.readouterr() == helped


def test_old_words_run_and_say_nothing_of_themselves_to_a_script(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "fleet.json5"
    config.write_text(EXAMPLE_CONFIG, encoding="utf-8")
    assert main(["config", "check", str(config)]) == 0
    new = capsys.readouterr()
    assert main(["check", str(config)]) == 0
    assert capsys.readouterr() == new
    assert new.err == ""


def test_old_words_tell_a_terminal_the_new_ones(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(["schema"]) == 0
    assert capsys.readouterr().err == "zacoustic schema: its name is now zacoustic config schema\n"
    assert main(["schema", "--json"]) == 0
    assert capsys.readouterr().err == ""
