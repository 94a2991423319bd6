"""The tree of verbs: finds the called one, and imports no other.

Leaves are our verbs (`zacoustic.app.cli.verbs`) and those of link packages, which come from the
entry-point group `zacoustic.commands`: the entry point ``emulate.desert`` is the verb
``run modems desert``, as `ALIASES` says. A leaf may have leaves below it (``sim``, ``sim
campaign``).
"""

import argparse
import difflib
import importlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from zacoustic.app.cli.verbs import ALIASES, GROUPS, VERBS
from zacoustic.errors import ConfigError
from zacoustic.link.command import Command, CommandGroup

Path = tuple[str, ...]
"""The words that call a verb or a group of verbs."""


class Tree:
    """Verbs by path, imported when they are called or listed.

    Args:
        leaves: Makes the verb of each path.
    """

    def __init__(self, leaves: Mapping[Path, Callable[[], Command]]) -> None:
        self._leaves = leaves

    def path_in(self, words: Sequence[str]) -> Path:
        """Return the longest path that words begin with; empty: none."""
        lengths = range(len(words), 0, -1)
        paths = (tuple(words[:length]) for length in lengths)
        return next((path for path in paths if self._knows(path)), ())

    def is_leaf(self, path: Path) -> bool:
        """Whether a path is a verb, not a group of verbs."""
        return path in self._leaves

    def below(self, path: Path) -> tuple[str, ...]:
        """Return the words that may follow a path."""
        depth = len(path)
        return tuple(
            dict.fromkeys(
                leaf[depth] for leaf in self._leaves if len(leaf) > depth and leaf[:depth] == path
            )
        )

    def called(self, path: Path) -> dict[str, Command]:
        """Return the verb of a path under its first word; all first words for the empty path.

        Raises:
            ZacousticError: The verb exists but cannot be imported.
        """
        if not path:
            return {word: self._listed((word,)) for word in self.below(())}
        return {path[0]: self._chain(path[:1], path)}

    def everything(self) -> dict[str, Command]:
        """Return all verbs and groups, except those that cannot be imported."""
        found = {word: self._complete((word,)) for word in self.below(())}
        return {word: command for word, command in found.items() if command is not None}

    def _knows(self, path: Path) -> bool:
        return path in self._leaves or bool(self.below(path))

    def _chain(self, here: Path, path: Path) -> Command:
        """Return the group here with the one called verb in it, or that verb."""
        if here != path:
            following = path[: len(here) + 1]
            return self._group(here, {following[-1]: self._chain(following, path)})
        if self.is_leaf(path):
            return _usable(self._leaves[path]())
        return self._group(here, {word: self._listed((*here, word)) for word in self.below(here)})

    def _listed(self, path: Path) -> Command:
        """Return a verb for a list; of a group, no member is imported."""
        return self._leaves[path]() if self.is_leaf(path) else self._group(path, {})

    def _group(self, path: Path, members: Mapping[str, Command]) -> CommandGroup:
        words = self.below(path)
        about = GROUPS.get(" ".join(path))
        summary = None if about is None else f"{', '.join(words)}: {about}"
        return CommandGroup(path[-1], members, words, summary)

    def _complete(self, path: Path) -> Command | None:
        found = {word: self._complete((*path, word)) for word in self.below(path)}
        members = {word: each for word, each in found.items() if each is not None}
        if not self.is_leaf(path):
            return self._group(path, members)
        alone = self._leaves[path]()
        if _is_unavailable(alone):
            return None
        return _AloneOrGroup(path[-1], alone, members) if members else alone


def tree_of(words: Sequence[str]) -> Tree:
    """Return the tree in which to look for words; link packages are asked only if they must be."""
    ours = Tree(_our_leaves())
    path = ours.path_in(words)
    return ours if ours.is_leaf(path) else whole_tree()


def whole_tree() -> Tree:
    """Return the tree of our verbs and those of link packages."""
    from zacoustic.link import registry

    installed = registry.commands()
    theirs = {
        _path_of_entry(name): partial(installed.__getitem__, name) for name in sorted(installed)
    }
    return Tree({**_our_leaves(), **theirs})


def renamed(arguments: Sequence[str]) -> tuple[list[str], str]:
    """Put the words of today in the place of those of earlier versions.

    Returns:
        The arguments, and the old words; empty: there are none.
    """
    first = next((at for at, word in enumerate(arguments) if not word.startswith("-")), None)
    if first is None:
        return list(arguments), ""
    for count in (2, 1):
        old = " ".join(arguments[first : first + count])
        if old in ALIASES:
            new = ALIASES[old].split()
            return [*arguments[:first], *new, *arguments[first + count :]], old
    return list(arguments), ""


def check_words(tree: Tree, path: Path, words: Sequence[str]) -> None:
    """Check that no word follows a group that is not in it.

    Raises:
        ConfigError: One does.
    """
    following = words[len(path) :]
    if tree.is_leaf(path) or not following:
        return
    known, called = tree.below(path), following[0]
    meant = {word: word for word in known}
    if not path:
        meant |= {old: new for old, new in ALIASES.items() if old not in meant}
    close = difflib.get_close_matches(called, meant, 1)
    hint = f'did you mean "{meant[close[0]]}"?' if close else "zacoustic --help explains them"
    raise ConfigError(f"no such verb; there are: {', '.join(known)}", hint=hint)


def built_in(place: str) -> Command:
    """Make one of our verbs.

    Args:
        place: Room, file and class, as `VERBS` names them.
    """
    module, _, name = place.rpartition(".")
    verb: type[Command] = getattr(importlib.import_module(f"{__package__}.{module}"), name)
    return verb()


def _our_leaves() -> dict[Path, Callable[[], Command]]:
    return {tuple(path.split()): partial(_make, place) for path, place in VERBS.items()}


def _make(place: str) -> Command:
    return built_in(place)


def _path_of_entry(name: str) -> Path:
    """Return the path of an entry point: its parts, with the words of today."""
    words, _ = renamed(name.split("."))
    return tuple(words)


def _is_unavailable(command: Command) -> bool:
    from zacoustic.link import registry

    return isinstance(command, registry.UnavailableCommand)


def _usable(command: Command) -> Command:
    from zacoustic.link import registry

    if isinstance(command, registry.UnavailableCommand):
        raise command.error
    return command


class _AloneOrGroup(CommandGroup):
    """A verb that takes a file or a sub-verb; for completion, which shows both.

    Argparse cannot distinguish the two; a call gets a parser of one or the other.
    """

    def __init__(self, name: str, alone: Command, members: Mapping[str, Command]) -> None:
        super().__init__(name, members, tuple(members), alone.summary)
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
