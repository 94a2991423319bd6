"""The command line: one file for each verb, one exit code for each kind of outcome.

`main` finds the verb, parses its arguments, runs it, and turns every expected error into one line
on standard error and an exit code (`zacoustic.command`)::

    0  it did what it was asked        2  arguments or a file are wrong; nothing was tried
    1  it tried and failed             3  no answer in the time that the user gave
    130  interrupted

Our own verbs are modules of this package that define `<Verb>Command`; those of link packages come
from the entry-point group `zacoustic.commands`. A verb is imported when it is called or listed, and
imports what is heavy when it runs, so that `zacoustic --help` starts no Zenoh.

What a verb does is in `zacoustic.tools`, `zacoustic.gateway` or `zacoustic.node`; the files here
read arguments and print results.
"""

import argparse
import contextlib
import difflib
import importlib
import logging
import os
import sys
from collections.abc import Mapping, Sequence
from typing import Final, NoReturn

from zacoustic.command import EXIT_FAILED, EXIT_TIMED_OUT, EXIT_USAGE, Command
from zacoustic.errors import ConfigError, ZacousticError

EXIT_INTERRUPTED: Final = 130
"""Ended by Ctrl-C before it was done: 128 and the number of SIGINT, as shells have it."""

BUILT_IN: Final = (
    "demo", "gateway", "check", "links", "pub", "sub", "call", "decode", "sim", "init",
)  # fmt: skip
"""Our verbs, in the order in which the help lists them."""

_EXAMPLE: Final = """example:
  zacoustic demo                     two islands joined through simulated water
  zacoustic gateway router.json5     join the Zenoh network here to the others
  zacoustic VERB --help              arguments and an example of each verb
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: The arguments without the name of the program; None: those of the process.

    Returns:
        The exit code.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    called = next((word for word in arguments if not word.startswith("-")), None)
    program = "zacoustic" if called is None else f"zacoustic {called}"
    try:
        code = _run(arguments, called)
        sys.stdout.flush()
    except SystemExit as end:  # argparse, after it has printed help, version or complaint
        return end.code if isinstance(end.code, int) else EXIT_USAGE
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        _silence_output()
        return EXIT_FAILED
    except ModuleNotFoundError as error:
        if (error.name or "zacoustic").startswith("zacoustic"):
            raise
        hint = "pip install 'zacoustic[terminal]' brings what the live views need"
        return _complain(program, f"needs {error.name}, which is not installed ({hint})")
    except ConfigError as error:
        return _complain(program, error, EXIT_USAGE)
    except TimeoutError as error:
        return _complain(program, str(error) or "no answer in time", EXIT_TIMED_OUT)
    except ZacousticError as error:
        return _complain(program, error)
    return code


class Parser(argparse.ArgumentParser):
    """A parser that complains in one line."""

    def error(self, message: str) -> NoReturn:
        """Print the complaint and exit."""
        self.exit(EXIT_USAGE, f"{self.prog}: {message} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    """Prints the installed version; looks it up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib import metadata

        print(f"zacoustic {metadata.version('zacoustic')}")
        parser.exit()


def _run(arguments: Sequence[str], called: str | None) -> int:
    verbs = _verbs(called)
    parser = _parser(verbs)
    parsed = parser.parse_args(arguments)
    _start_logging(verbose=parsed.verbose)
    return verbs[parsed.verb].run(parsed)


def _verbs(called: str | None) -> Mapping[str, Command]:
    """The verb that is called, or all of them for the list.

    Raises:
        ConfigError: There is no such verb.
        ZacousticError: It is there and cannot be imported.
    """
    if called in BUILT_IN:
        return {called: _built_in(called)}
    from zacoustic import registry

    installed = registry.commands()
    if called is None:
        return {**installed, **{name: _built_in(name) for name in BUILT_IN}}
    if called not in installed:
        known = [*BUILT_IN, *installed]
        close = difflib.get_close_matches(called, known, 1)
        hint = f'did you mean "{close[0]}"?' if close else "zacoustic --help explains them"
        raise ConfigError(f"no such verb; there are: {', '.join(known)}", hint=hint)
    verb = installed[called]
    if isinstance(verb, registry.UnavailableCommand):
        raise verb.error
    return {called: verb}


def _built_in(name: str) -> Command:
    module = importlib.import_module(f"{__name__}.{name}")
    command_type: type[Command] = getattr(module, f"{name.capitalize()}Command")
    return command_type()


def _parser(verbs: Mapping[str, Command]) -> Parser:
    parser = Parser(
        prog="zacoustic",
        description="Zenoh over sound: joins islands of Zenoh through acoustic modems.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="say on standard error what goes on"
    )
    choices = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=Parser)
    for name, verb in sorted(verbs.items(), key=_order):
        child = choices.add_parser(
            name,
            help=verb.summary,
            description=f"{verb.summary[:1].upper()}{verb.summary[1:]}.",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        verb.add_arguments(child)
    return parser


def _order(item: tuple[str, Command]) -> tuple[int, str]:
    """Our verbs in their order, then those of link packages by name."""
    name = item[0]
    return (BUILT_IN.index(name) if name in BUILT_IN else len(BUILT_IN), name)


def _start_logging(*, verbose: bool) -> None:
    # Standard error always: with --json, standard output carries JSON only.
    logging.basicConfig(
        level=logging.INFO if verbose else logging.WARNING,
        format="zacoustic: %(message)s",
        stream=sys.stderr,
    )


def _complain(program: str, error: object, code: int = EXIT_FAILED) -> int:
    """Print one line, whatever the message holds."""
    with contextlib.suppress(BrokenPipeError):
        print(f"{program}: {' '.join(str(error).split())}", file=sys.stderr)
    return code


def _silence_output() -> None:
    """Point standard output to nowhere: the interpreter flushes it once more at the end."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
