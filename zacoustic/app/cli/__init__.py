"""The command line: one declaration for each verb, one exit code for each kind of outcome.

`main` finds the verb, parses its arguments, runs it, and turns every expected error into one line
on standard error and an exit code (`zacoustic.link.command`)::

    0  the verb succeeded             2  arguments or a file are wrong; nothing was tried
    1  it tried and failed            3  no answer within the time that the user gave
    130  interrupted

`zacoustic.app.cli.verbs` is the table of our verbs; `zacoustic.app.cli.tree` finds the called one
in it or among those of link packages. A verb is imported when it is called or listed, and imports
heavy modules only when it runs, so that `zacoustic --help` does not load Zenoh.

A verb of ours is a class (`zacoustic.app.cli.support.verb`): its docstring is its help, its rows
are its arguments, and `work` is what it does. The work itself is done in `zacoustic.app.tools`,
`zacoustic.zenoh.gateway` or `zacoustic.zenoh.node`.
"""

import argparse
import contextlib
import logging
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, Final, NoReturn

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.printing import print_note, print_text
from zacoustic.app.cli.support.streams import UNREAD, flush_output
from zacoustic.app.cli.tree import check_words, renamed, tree_of, whole_tree
from zacoustic.app.cli.verbs import ALIASES, HEADINGS
from zacoustic.app.tools.columns import within
from zacoustic.errors import ConfigError, ZacousticError
from zacoustic.link.command import (
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    EXIT_OK,
    EXIT_TIMED_OUT,
    EXIT_USAGE,
    Command,
    CommandGroup,
    add_command,
)
from zacoustic.text.helptext import HelpFormatter
from zacoustic.text.installing import with_extra
from zacoustic.text.safetext import one_line, some_lines, without_secrets

_EXTRAS: Final = {
    "cryptography": "secure", "dask": "campaign", "distributed": "campaign",
    "matplotlib": "report", "mcap": "recording", "nicegui": "console",
    "prometheus_client": "metrics", "pyarrow": "campaign", "pymavlink": "mavlink",
    "rich": "terminal", "rosbags": "ros", "shtab": "completion", "xxhash": "ros",
}  # fmt: skip
"""Our extra that brings a module that may be absent."""
_PACKAGES: Final = {"serial": "pyserial", "zenoh": "eclipse-zenoh"}
"""Package to install for another such module, if its name differs."""

_EXAMPLE: Final = """example:
  zacoustic run demo                   two networks, a simulated channel
  zacoustic run gateway router.json5   join this network to the others
  zacoustic VERB --help                arguments and an example
"""
_WIDTH: Final = 80
_INDENT: Final = 14


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: The arguments without the program's name; None: those of the process.

    Returns:
        The exit code.
    """
    arguments, old = renamed(sys.argv[1:] if argv is None else argv)
    program = "zacoustic"
    try:
        program = _program(arguments)
        _tell_new_words(arguments, old)
        code = _run(program, arguments)
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    failure = flush_output()
    if failure and code in (EXIT_OK, EXIT_FAILED):
        return EXIT_FAILED if code or failure == UNREAD else _complain(program, failure)
    return code


def _run(program: str, arguments: Sequence[str]) -> int:
    """Run a verb; turn its errors into one line on standard error and an exit code."""
    try:
        verb, parsed = parse(arguments)
        _start_logging(verbose=parsed.verbose)
        with within(shutil.get_terminal_size().columns if sys.stdout.isatty() else None):
            if not verb.prints_late:
                return verb.run(parsed)
            with AT_WORK.begin(program):
                return verb.run(parsed)
    except SystemExit as end:  # argparse, after it has printed help, version or an error
        return end.code if isinstance(end.code, int) else EXIT_USAGE
    except ModuleNotFoundError as error:
        if (error.name or "zacoustic").startswith("zacoustic"):
            raise
        return _complain(program, absent_module(error.name or ""))
    except ConfigError as error:
        return _complain(program, error, EXIT_USAGE)
    except TimeoutError as error:
        return _complain(program, str(error) or "no answer in time", EXIT_TIMED_OUT)
    except ZacousticError as error:
        return _complain(program, error)
    except BrokenPipeError:
        return EXIT_FAILED
    except OSError as error:  # for example a full disk
        place = f"{error.filename}: " if error.filename else ""
        return _complain(program, f"{place}{error.strerror or error}")


def absent_module(name: str) -> str:
    """Return the message for a missing module."""
    module = name.partition(".")[0]
    if (extra := _EXTRAS.get(module)) is not None:
        advice = with_extra(extra)
    else:
        advice = f"pip install {_PACKAGES.get(module, name)}"
    return f"needs {name}, which is not installed ({advice})"


def parse(arguments: Sequence[str]) -> tuple[Command, argparse.Namespace]:
    """Find the called verb and parse its arguments.

    Args:
        arguments: Arguments of the process, without the name of the program.

    Returns:
        The verb itself, below its groups, and its arguments.

    Raises:
        SystemExit: Argparse has printed help, the version, or an error.
        ConfigError: There is no such verb, or it has no such argument.
        ZacousticError: The verb exists but cannot be imported.
    """
    arguments, _ = renamed(arguments)
    words = _words(arguments)
    tree = tree_of(words)
    path = tree.path_in(words)
    check_words(tree, path, words)
    verbs = tree.called(path)
    # Argparse would report surplus arguments in the name of the whole program.
    parsed, strangers = _parser(verbs).parse_known_args(arguments)
    if strangers:
        program = " ".join(["zacoustic", *path])
        raise ConfigError(
            f"unrecognized arguments: {' '.join(strangers)}", hint=f"see {program} --help"
        )
    verb = verbs[parsed.verb]
    while isinstance(verb, CommandGroup):
        verb = verb.chosen(parsed)
    return verb, parsed


def complete_parser() -> argparse.ArgumentParser:
    """Return a parser with all verbs and sub-verbs, except those that cannot be imported."""
    return _parser(whole_tree().everything())


class Parser(argparse.ArgumentParser):
    """A parser that prints errors in one line, the same ones on every version of Python."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:  # noqa: ANN401
        """Refuse a word that is none of the choices; argparse's own text differs by version."""
        if action.choices is not None and value not in action.choices:
            name = "/".join(action.option_strings) or str(action.metavar or action.dest)
            allowed = ", ".join(map(str, action.choices))
            raise argparse.ArgumentError(None, f"{name} {value}; allowed: {allowed}")

    def error(self, message: str) -> NoReturn:
        """Print the error and exit."""
        self.exit(EXIT_USAGE, f"{one_line(f'{self.prog}: {message} (see {self.prog} --help)')}\n")


class _Version(argparse.Action):
    """Prints the installed version; looks it up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib import metadata

        print_text(f"zacoustic {metadata.version('zacoustic')}")
        parser.exit()


def _words(arguments: Sequence[str]) -> list[str]:
    return [word for word in arguments if not word.startswith("-")]


def _program(arguments: Sequence[str]) -> str:
    """Return the words that name the call; a wrong one is among them."""
    words = _words(arguments)
    tree = tree_of(words)
    path = tree.path_in(words)
    wrong = () if tree.is_leaf(path) else words[len(path) : len(path) + 1]
    return " ".join(["zacoustic", *path, *wrong])


def _tell_new_words(arguments: Sequence[str], old: str) -> None:
    """Say on a terminal what old words are called now; a log or a script is not disturbed."""
    if old and "--json" not in arguments and sys.stderr.isatty():
        print_note(f"zacoustic {old}: its name is now zacoustic {ALIASES[old]}")


class _WholeParser(Parser):
    """The parser of the program; its help has the verbs under headings."""

    def format_help(self) -> str:
        """Return the help."""
        (choices,) = (
            each for each in self._actions if isinstance(each, argparse._SubParsersAction)
        )
        summaries = {each.dest: each.help or "" for each in choices._choices_actions}
        listed = {word for words in HEADINGS.values() for word in words}
        others = tuple(word for word in summaries if word not in listed)
        lines = [f"usage: {self.prog} [-h] [--version] [-v] VERB ...", "", self.description or ""]
        for heading, words in {**HEADINGS, "of link packages": others}.items():
            if any(word in summaries for word in words):
                lines += ["", f"{heading}:"]
                lines += [_entry(word, summaries[word]) for word in words if word in summaries]
        lines += ["", "options:"]
        options = {
            ", ".join(each.option_strings): each.help or ""
            for each in self._actions
            if each.option_strings
        }
        lines += [_entry(*option) for option in options.items()]
        return "\n".join([*lines, "", self.epilog or ""])


def _entry(name: str, text: str) -> str:
    """Return the lines of one entry of the help, within the width."""
    first = f"  {name:<{_INDENT - 3}} "
    before = "" if len(first) == _INDENT else f"{first.rstrip()}\n"
    wrapped = textwrap.fill(
        text.replace("%%", "%"),
        _WIDTH,
        initial_indent=" " * _INDENT if before else first,
        subsequent_indent=" " * _INDENT,
    )
    return f"{before}{wrapped}"


def _parser(verbs: Mapping[str, Command]) -> Parser:
    parser = _WholeParser(
        prog="zacoustic",
        description="Zenoh over sound: joins Zenoh networks through acoustic modems.",
        epilog=_EXAMPLE,
        formatter_class=HelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.add_argument("-v", "--verbose", action="store_true", help="log to standard error")
    choices = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=Parser)
    for name, verb in verbs.items():
        add_command(choices, name, verb)
    return parser


def _start_logging(*, verbose: bool) -> None:
    # Always standard error: with --json, standard output carries only JSON.
    logging.raiseExceptions = False  # a full disk under standard error is no reason to fail
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Formatter("zacoustic: %(message)s"))
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, handlers=[handler])


class _Formatter(logging.Formatter):
    """Formats any message as one line; a traceback follows in its own lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 (of the base)
        return one_line(without_secrets(super().formatMessage(record)))

    def formatException(self, ei: Any) -> str:  # noqa: ANN401, N802 (of the base)
        return some_lines(without_secrets(super().formatException(ei)))


def _complain(program: str, error: object, code: int = EXIT_FAILED) -> int:
    """Print an error as one line."""
    with contextlib.suppress(OSError):
        print_note(f"{program}: {' '.join(str(error).split())}")
    return code
