"""The verb `zacoustic completion`."""

import argparse
from pathlib import Path
from typing import Final

from zacoustic.app.cli.support.printing import print_text
from zacoustic.app.cli.support.rows import option, word
from zacoustic.app.cli.support.verb import Verb
from zacoustic.errors import ConfigError

SHELLS: Final = ("bash", "zsh", "fish")
"""Shells with a script."""

# Placeholders of files and folders in our parsers: the shell completes names there.
_FILES: Final = ("FILE", "RECORDING", "SCENARIO", "CONFIG", "MODEL", "PAGE", "HEX|FILE")
_FOLDERS: Final = ("FOLDER",)

# Placeholders of names that a file has; what is in it is asked for when the shell completes.
_NAMES: Final = {
    "KEY": "topic", "TOPIC": "topic", "SERVICE": "service", "ACTION": "action",
    "STREAM": "stream", "NODE": "node",
}  # fmt: skip
_BASH: Final = """_zacoustic_names_{kind}() {{
  compgen -W "$(zacoustic completion --names {kind} --line "${{COMP_WORDS[*]}}" 2>/dev/null)" \\
    -- "$1"
}}
"""
_ZSH: Final = """_zacoustic_names_{kind}() {{
  compadd -- $(zacoustic completion --names {kind} --line "${{words[*]}}" 2>/dev/null)
}}
"""
_FISH: Final = """function _zacoustic_names_{kind}
  zacoustic completion --names {kind} --line (commandline -p | string collect) 2>/dev/null
end
"""


class Completion(Verb):
    """Print a script with which bash, zsh or fish completes the command line.

    Make it anew after an update: it knows the verbs and options of this version,
    and those of the link packages that are installed. Names of streams and addresses of nodes are
    those of the file of the command line, or of the only one in the folder.

    Examples:
      zacoustic completion bash > ~/.local/share/bash-completion/completions/zacoustic
      zacoustic completion zsh > "${fpath[1]}/_zacoustic"
      zacoustic completion fish > ~/.config/fish/completions/zacoustic.fish
    """

    prints_late = False

    shell: str | None = word(None, "which shell", "?", choices=SHELLS)
    # Asked by the script while somebody types.
    names: str | None = option(None, argparse.SUPPRESS)
    line_: str = option(None, argparse.SUPPRESS, "")
    json = False

    def work(self) -> None:
        """Print it.

        Raises:
            ConfigError: No shell is named.
        """
        if self.names is not None:
            _print_names(self.names, self.line_)
            return
        if self.shell is None:
            raise ConfigError(f"SHELL; allowed: {', '.join(SHELLS)}")
        import shtab

        from zacoustic.app.cli import complete_parser

        parser = complete_parser()
        _name_files(parser)
        print_text(shtab.complete(parser, shell=self.shell))


def _name_files(parser: argparse.ArgumentParser) -> None:
    """Mark the arguments that are files, in a parser and those below it."""
    import shtab

    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _name_files(below)
        elif action.metavar in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif action.metavar in _FOLDERS:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif kind := _kind_of(action):
            action.complete = _asking(kind)  # type: ignore[attr-defined]


def _kind_of(action: argparse.Action) -> str | None:
    """Return what an argument names in the file, or None."""
    if "--node" in action.option_strings:
        return "node"
    return None if action.option_strings else _NAMES.get(str(action.metavar))


def _asking(kind: str) -> dict[str, object]:
    """Return how each shell asks for the names of a kind, in the form of shtab."""
    function = f"_zacoustic_names_{kind}"
    return {
        "bash": function,
        "zsh": function,
        "fish": f"({function})",
        "preamble": {
            "bash": _BASH.format(kind=kind),
            "zsh": _ZSH.format(kind=kind),
            "fish": _FISH.format(kind=kind),
        },
    }


def _print_names(kind: str, line: str) -> None:
    from zacoustic.app.tools.field.names import KINDS, names_for

    if kind in KINDS:
        print_text("\n".join(names_for(kind, line, Path())))
