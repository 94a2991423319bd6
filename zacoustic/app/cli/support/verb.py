"""A verb of ours is one class, and one runner does for all of them what each would repeat.

The class says what the user reads, what he may type, and what is done::

    class Hz(Participant):
        '''How often samples of a topic arrive: mean, shortest and longest time between.

        It counts the samples that arrive on this network or link: ...
        '''

        key: str = word("KEY", "topic of the config, or key expression")
        interval: float = seconds("time between two lines, s", 5.0)
        runs_on = True

        async def work(self) -> int: ...

The first line of its docstring is its line in the list of verbs, the rest is the end of its help.
Arguments that several verbs share are those of a base class: they follow the verb's own, and
`--json` is the last. The runner (`Verb.run`) checks the limits of the arguments, puts their values
in the place of the rows, runs `work` (on a loop, if it is a coroutine) and returns its exit code.
Errors become exit codes in `zacoustic.app.cli.main`.
"""

import argparse
import inspect
from abc import abstractmethod
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from zacoustic.app.cli.support.printing import (
    print_json,
    print_line,
    print_note,
    print_result,
    print_text,
)
from zacoustic.app.cli.support.rows import ONE_OBJECT, Row, endpoint, flag, option, whole, word
from zacoustic.link.command import EXIT_OK, Command

if TYPE_CHECKING:
    import asyncio

    from zacoustic.config import Config

T = TypeVar("T")


class Verb(Command):
    """A verb by its declaration. Must define: `work`."""

    prints_late = True
    epilog: ClassVar[str]
    """The end of its help: what else there is to know, and an example."""
    runs_on: ClassVar[bool] = False
    """Whether SIGINT or SIGTERM ends it regularly, with exit code 0; `stop` then ends it, too."""

    json: bool = flag(ONE_OBJECT)
    program: str
    """The words that call it, for messages."""
    stop: "asyncio.Event"

    def __init_subclass__(cls) -> None:
        """Take the texts from the docstring."""
        head, _, rest = inspect.cleandoc(cls.__doc__ or "").partition("\n\n")
        if "epilog" not in vars(cls):  # a docstring takes no figures of the code
            cls.epilog = f"\n{rest}".replace("\nExample", "\nexample")[1:]
        summary = " ".join(head.split()).removesuffix(".")
        cls.summary = summary[:1].lower() + summary[1:]

    @abstractmethod
    def work(self) -> "Coroutine[Any, Any, int | None] | int | None":
        """Do it, and return the exit code; None: it has succeeded."""

    def rows(self) -> dict[str, Row]:
        """Return the arguments by name: its own, those of its bases, `json`."""
        names = dict.fromkeys(name for each in type(self).__mro__ for name in vars(each))
        found = {name: row for name in names if isinstance(row := getattr(type(self), name), Row)}
        if "json" in found:
            found["json"] = found.pop("json")
        return found

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments, and the end of the help."""
        # Set on the instance, not on the class: the tree of verbs knows the words.
        self.name = parser.prog.rpartition(" ")[2]  # type: ignore[misc]
        self.program = parser.prog
        parser.epilog = self.epilog
        groups: dict[str, argparse._ArgumentGroup] = {}
        for name, row in self.rows().items():
            group = row.title or row.either
            if row.title and group not in groups:
                groups[group] = parser.add_argument_group(row.title)
            elif group and group not in groups:
                groups[group] = parser.add_mutually_exclusive_group(required=row.required)
            row.add_to(groups.get(group, parser), name)

    def run(self, arguments: argparse.Namespace) -> int:
        """Run the verb with these arguments.

        Raises:
            ConfigError: An argument is outside its limits; or `work` finds something wrong.
        """
        for name, row in self.rows().items():
            value = getattr(arguments, name)
            row.check(name, value)
            setattr(self, name, value)
        if self.runs_on:
            from zacoustic.link.serving import run_until_stopped

            return run_until_stopped(self._run_on) or EXIT_OK
        done = self.work()
        if isinstance(done, Coroutine):
            import asyncio

            done = asyncio.run(done)
        return done or EXIT_OK

    async def _run_on(self, stop: "asyncio.Event") -> int | None:
        self.stop = stop
        done = self.work()
        return await done if isinstance(done, Coroutine) else done

    def show(self, result: T, text: Callable[[T], str]) -> None:
        """Print the result, for people or as one JSON object."""
        print_result(result, text, as_json=self.json)

    def line(self, record: dict[str, Any], text: str) -> None:
        """Print one of the results in a line: its text, or the record as JSON."""
        print_line(record, text, as_json=self.json)

    def tell(self, record: object, text: str) -> None:
        """Print what has happened while it runs on; it ends when nobody reads that any more."""
        try:
            if self.json:
                print_json(record, flush=True)
            else:
                print_text(text, flush=True)
        except BrokenPipeError:
            self.stop.set()

    def note(self, text: str) -> None:
        """Print a line on standard error, in the name of the verb."""
        print_note(f"{self.program}: {text}")


class FleetVerb(Verb):
    """A verb that takes a configuration which may be left out."""

    config: str | None = option("FILE", "file with the section plugins.acoustic")

    def fleet(self) -> "Config | None":
        """Read the configuration; None: none is given.

        Raises:
            ConfigError: The file is wrong.
        """
        from zacoustic.app.tools.fleetfile import read_fleet

        return None if self.config is None else read_fleet(self.config)


class NetworkVerb(FleetVerb):
    """A verb that joins a Zenoh network and needs no streams of a file."""

    connect: list[str] | None = endpoint()
    config: str | None = option("FILE", "file with the endpoints of the router")


class NodeFileVerb(Verb):
    """A verb that takes the file of a node."""

    file: str = word("FILE", "Zenoh config with plugins.acoustic")
    address: int | None = whole("N", "address of this node, instead of the file's")


class LinkedVerb(NodeFileVerb):
    """A verb that takes the file of a node, and perhaps its modem."""

    link: str | None = option("LOCATOR", "the modem, instead of the file's: NAME/ADDRESS")
