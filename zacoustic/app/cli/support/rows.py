"""The arguments of a verb: each is one row of its class, a typed attribute with what is allowed.

A row says what an argument is called in help, what it means, its default and its limits. The
attribute's name is the option's name, and its annotation the type of the value::

    interval: float = seconds("time between two lines, s", 5.0)      # --interval S
    key: str = word("KEY", "topic of the config, or key expression")  # the first word

`zacoustic.app.cli.support.verb.Verb` adds the rows to its parser, checks the values and puts them
in the place of the rows.
"""

import argparse
from collections.abc import Sequence
from typing import Any, Final

from zacoustic.core.base.clock import LONGEST_S, SHORTEST_S
from zacoustic.errors import ConfigError

ONE_OBJECT: Final = "one JSON object"
OBJECT_PER_LINE: Final = "one JSON object per line"

MOST_NODES: Final = 254
"""The largest acoustic address of a node."""
_MOST: Final = 1_000_000_000
_DEFAULTS: Final = {int: "%(default)d", float: "%(default)g"}

_Adds = argparse.ArgumentParser | argparse._ArgumentGroup


class Row:
    """One argument.

    Args:
        flags: The option as it is typed; empty: made of the attribute's name; None: a word.
        meaning: Its help.
        limits: Least and most of a number.
        either: Name of the group of which only one argument may be given.
        title: Heading of the group in the help.
        required: Whether it must be given, or one of its group.
        settings: As `argparse.ArgumentParser.add_argument` takes them.
    """

    def __init__(
        self,
        flags: tuple[str, ...] | None,
        meaning: str,
        *,
        limits: tuple[float, float] | None = None,
        either: str = "",
        title: str = "",
        required: bool = False,
        **settings: Any,
    ) -> None:
        self.either, self.title, self.required = either, title, required
        self._flags, self._limits, self._settings = flags, limits, settings
        default = settings.get("default")
        if default and not isinstance(default, list) and "default" not in meaning:
            meaning += f" (default: {_DEFAULTS.get(type(default), '%(default)s')})"
        if settings.get("action") == "append" and "may be given" not in meaning:
            meaning += "; may be given again"
        self._meaning = meaning

    def add_to(self, place: _Adds, name: str) -> None:
        """Declare the argument of this name to argparse."""
        if self._flags is None:
            place.add_argument(name, help=self._meaning, **self._settings)
            return
        if self.required and not self.either:
            self._settings["required"] = True
        flags = self._flags or (option_of(name),)
        place.add_argument(*flags, dest=name, help=self._meaning, **self._settings)

    def check(self, name: str, value: Any) -> None:
        """Check a value.

        Raises:
            ConfigError: It is outside the limits.
        """
        if self._limits is not None and value is not None:
            unit = " s" if self._settings["metavar"] == "S" else ""
            check_within(option_of(name), value, *self._limits, unit=unit)


def word(metavar: str | None, meaning: str, many: str | None = None, **settings: Any) -> Any:
    """Declare an argument without a name.

    Args:
        metavar: Its name in the help.
        meaning: Its help.
        many: How many: ``?``, ``*`` or ``+``; None: one.
        settings: Those of `Row`.
    """
    return Row(None, meaning, metavar=metavar, nargs=many, **settings)


def option(metavar: str | None, meaning: str, default: Any = None, **settings: Any) -> Any:
    """Declare an option with a text, or of another `type`."""
    return Row(settings.pop("flags", ()), meaning, metavar=metavar, default=default, **settings)


def repeated(metavar: str, meaning: str, default: Sequence[Any] | None = (), **more: Any) -> Any:
    """Declare an option that may be given again; its value is a list."""
    made = None if default is None else [*default]
    return option(metavar, meaning, made, action="append", **more)


def flag(meaning: str, **settings: Any) -> Any:
    """Declare an option without a value: a bool."""
    return Row((), meaning, action="store_true", **settings)


def whole(
    metavar: str | None,
    meaning: str,
    default: int | None = None,
    *,
    least: int | None = None,
    most: int = _MOST,
    **settings: Any,
) -> Any:
    """Declare an option with a whole number, within limits if it has a least."""
    limits = None if least is None else (least, most)
    return option(metavar, meaning, default, type=int, limits=limits, **settings)


def node_address(meaning: str, default: int | None = None, **settings: Any) -> Any:
    """Declare an option with the acoustic address of a node."""
    return whole("N", meaning, default, least=1, most=MOST_NODES, **settings)


def real(
    metavar: str,
    meaning: str,
    default: float | None = None,
    *,
    least: float = SHORTEST_S,
    most: float = LONGEST_S,
    **settings: Any,
) -> Any:
    """Declare an option with a number within limits: above 0, unless there is a least."""
    return option(metavar, meaning, default, type=float, limits=(least, most), **settings)


def seconds(meaning: str, default: float | None = None, **settings: Any) -> Any:
    """Declare an option with a duration, s."""
    return real("S", meaning, default, **settings)


def endpoint(**settings: Any) -> Any:
    """Declare where Zenoh is joined."""
    return repeated("ENDPOINT", "Zenoh endpoint, tcp/HOST:PORT", None, **settings)


def modem_profile(what: str) -> Any:
    """Declare an option with a modem profile."""
    return option("NAME", f"modem{what} (default: the EvoLogics 18/34)")


def option_of(name: str) -> str:
    """Return the option of an attribute: `lost_after` is ``--lost-after``."""
    return f"--{name.rstrip('_').replace('_', '-')}"


def check_within(name: str, value: float, least: float, most: float, *, unit: str = "") -> None:
    """Check a number.

    Args:
        name: The argument as the user writes it.
        value: Its value; NaN is refused.
        least: The least allowed.
        most: The most allowed.
        unit: Unit of these, with a blank before it.

    Raises:
        ConfigError: It is outside.
    """
    if not least <= value <= most:
        above = "above 0, " if least == SHORTEST_S else ""
        limits = f"{_shown(least)}..{_shown(most)}"
        raise ConfigError(f"{name} {_shown(value)}; allowed: {above}{limits}{unit}")


def _shown(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"
