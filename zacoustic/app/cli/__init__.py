"""The command line: one file for each verb, one exit code for each kind of outcome.

`main` finds the verb, parses its arguments, runs it, and turns every expected error into one line
on standard error and an exit code (`zacoustic.link.command`)::

    0  the verb succeeded             2  arguments or a file are wrong; nothing was tried
    1  it tried and failed            3  no answer within the time that the user gave
    130  interrupted

Our own verbs are modules in the subpackages of this package that define `<Verb>Command`. Those of
link packages come from the entry-point group `zacoustic.commands`, where `emulate.desert` is the
sub-verb `desert` of `emulate`, a verb that several packages may share. A verb is imported when it
is called or listed, and imports heavy modules only when it runs, so that `zacoustic --help` does
not load Zenoh.

The work of a verb is done in `zacoustic.app.tools`, `zacoustic.zenoh.gateway` or
`zacoustic.zenoh.node`; the files here read arguments and print results.
"""

import argparse
import contextlib
import difflib
import importlib
import logging
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NoReturn

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.printing import print_note, print_text
from zacoustic.app.cli.support.streams import UNREAD, flush_output
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
from zacoustic.text.installing import with_extra
from zacoustic.text.safetext import one_line, some_lines, without_secrets

_ROOMS: Final = {
    "use": ("gateway", "pub", "sub", "call", "action", "ping", "mavlink"),
    "watch": ("topics", "monitor", "dashboard"),
    "remote": ("silence", "resume", "stream", "route"),
    "recordings": ("journal", "decode", "record", "replay", "report"),
    "design": ("demo", "check", "plan", "sim", "campaign", "init", "schema", "fit", "bench"),
    "host": ("doctor", "predive", "links", "completion"),
    "security": ("key", "acl", "audit"),
}
"""The verbs of each subpackage."""
_ROOM_OF: Final = {verb: room for room, verbs in _ROOMS.items() for verb in verbs}
BUILT_IN: Final = (
    "demo", "gateway", "check", "plan", "doctor", "predive", "links", "pub", "sub", "call",
    "action", "ping", "mavlink", "topics", "monitor", "dashboard", "silence", "resume", "stream",
    "route", "journal", "audit", "key", "acl", "decode", "sim", "record", "replay", "report",
    "init", "schema", "fit", "bench", "completion",
)  # fmt: skip
"""Our verbs, in the order of the help."""
_SUB_VERBS: Final = {"sim": ("campaign",)}
"""Sub-verbs of our verbs that also take a file in place of a sub-verb."""

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
  zacoustic demo                     two local networks joined through a simulated channel
  zacoustic gateway router.json5     join the Zenoh network here to the others
  zacoustic VERB --help              arguments and an example of each verb
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: The arguments without the program's name; None: those of the process.

    Returns:
        The exit code.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    program = "zacoustic"
    try:
        program = " ".join([program, *_path(arguments)])
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

    Raises:
        SystemExit: Argparse has printed help, the version, or an error.
        ConfigError: There is no such verb, or it has no such argument.
        ZacousticError: The verb exists but cannot be imported.
    """
    path = _path(arguments)
    verbs = _verbs(path)
    # Argparse would report surplus arguments in the name of the whole program.
    parsed, strangers = _parser(verbs).parse_known_args(arguments)
    if strangers:
        program = " ".join(["zacoustic", *path])
        raise ConfigError(
            f"unrecognized arguments: {' '.join(strangers)}", hint=f"see {program} --help"
        )
    return verbs[parsed.verb], parsed


def complete_parser() -> argparse.ArgumentParser:
    """Return a parser with all verbs and sub-verbs, except those that cannot be imported."""
    from zacoustic.link import registry

    verbs: dict[str, Command] = {name: _with_sub_verbs(name) for name in BUILT_IN}
    usable = {
        name: command
        for name, command in registry.commands().items()
        if not isinstance(command, registry.UnavailableCommand)
    }
    for name in sorted({name.partition(".")[0] for name in usable}):
        below = _sub_verbs(name, usable)
        members = {sub_verb: usable[full] for sub_verb, full in below.items()}
        verbs[name] = CommandGroup(name, members, tuple(below)) if below else usable[name]
    return _parser(verbs)


class Parser(argparse.ArgumentParser):
    """A parser that prints errors in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the error and exit."""
        self.exit(EXIT_USAGE, f"{one_line(f'{self.prog}: {message} (see {self.prog} --help)')}\n")


class _Version(argparse.Action):
    """Prints the installed version; looks it up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib import metadata

        print_text(f"zacoustic {metadata.version('zacoustic')}")
        parser.exit()


def _path(arguments: Sequence[str]) -> Sequence[str]:
    """Return the words that name the call: a verb, a verb and its sub-verb, or none."""
    words = [word for word in arguments if not word.startswith("-")]
    if not words or words[0] in BUILT_IN:
        return words[: 2 if words[1:] and words[1] in _SUB_VERBS.get(words[0], ()) else 1]
    from zacoustic.link import registry

    return words[: 2 if _sub_verbs(words[0], registry.commands()) else 1]


def _verbs(path: Sequence[str]) -> Mapping[str, Command]:
    """Return the called verb, or all of them for the list; import no other.

    Raises:
        ConfigError: There is no such verb.
        ZacousticError: The verb exists but cannot be imported.
    """
    if path and path[0] in BUILT_IN:
        verb, *sub_verb = path
        members = {each: _built_in(each) for each in sub_verb}
        return {verb: CommandGroup(verb, members, tuple(members)) if members else _built_in(verb)}
    from zacoustic.link import registry

    installed = registry.commands()
    names = sorted({name.partition(".")[0] for name in installed})
    if not path:
        listed = {name: _listed(name, installed) for name in names}
        return {**listed, **{name: _built_in(name) for name in BUILT_IN}}
    verb, *sub_verb = path
    _must_be_one_of([*BUILT_IN, *names], verb)
    sub_verbs = _sub_verbs(verb, installed)
    if not sub_verbs:
        return {verb: _usable(installed[verb])}
    members = {name: installed[full] for name, full in sub_verbs.items() if not sub_verb}
    for name in sub_verb:
        _must_be_one_of(list(sub_verbs), name)
        members[name] = _usable(installed[sub_verbs[name]])
    return {verb: CommandGroup(verb, members, tuple(sub_verbs))}


def _sub_verbs(verb: str, installed: Iterable[str]) -> dict[str, str]:
    """Return the names of a verb's sub-verbs, with the names of their entry points."""
    head = f"{verb}."
    return {name.removeprefix(head): name for name in installed if name.startswith(head)}


def _listed(verb: str, installed: Mapping[str, Command]) -> Command:
    """Return an installed verb for the list, without importing sub-verbs."""
    sub_verbs = _sub_verbs(verb, installed)
    return CommandGroup(verb, {}, tuple(sub_verbs)) if sub_verbs else installed[verb]


def _usable(command: Command) -> Command:
    from zacoustic.link import registry

    if isinstance(command, registry.UnavailableCommand):
        raise command.error
    return command


def _must_be_one_of(known: Sequence[str], called: str) -> None:
    if called not in known:
        close = difflib.get_close_matches(called, known, 1)
        hint = f'did you mean "{close[0]}"?' if close else "zacoustic --help explains them"
        raise ConfigError(f"no such verb; there are: {', '.join(known)}", hint=hint)


def _built_in(name: str) -> Command:
    module = importlib.import_module(f"{__name__}.{_ROOM_OF[name]}.{name}")
    command_type: type[Command] = getattr(module, f"{name.capitalize()}Command")
    return command_type()


def _with_sub_verbs(name: str) -> Command:
    members = {each: _built_in(each) for each in _SUB_VERBS.get(name, ())}
    return _AloneOrGroup(_built_in(name), members) if members else _built_in(name)


class _AloneOrGroup(CommandGroup):
    """A verb that takes a file or a sub-verb; for completion, which shows both.

    Argparse cannot distinguish the two; a call gets a parser of one or the other.
    """

    def __init__(self, alone: Command, members: Mapping[str, Command]) -> None:
        super().__init__(alone.name, members, tuple(members))
        self._alone = alone

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments of both."""
        self._alone.add_arguments(parser)
        epilog = parser.epilog
        super().add_arguments(parser)
        parser.epilog = epilog
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                action.required = False


def _parser(verbs: Mapping[str, Command]) -> Parser:
    parser = Parser(
        prog="zacoustic",
        description="Zenoh over sound: joins Zenoh networks through acoustic modems.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.add_argument("-v", "--verbose", action="store_true", help="log to standard error")
    choices = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=Parser)
    for name, verb in sorted(verbs.items(), key=_order):
        add_command(choices, name, verb)
    return parser


def _order(item: tuple[str, Command]) -> tuple[int, str]:
    """Sort key: our verbs in their order, then those of link packages by name."""
    name = item[0]
    return (BUILT_IN.index(name) if name in BUILT_IN else len(BUILT_IN), name)


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
