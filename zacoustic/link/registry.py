"""Links and verbs by name: the installed ones, found through entry points.

Nothing in `zacoustic` names a link. Any package registers a class in the group `zacoustic.links`
and, if it has verbs for the command line, in `zacoustic.commands`. Our own links do the same, so
the way for third parties is tested.

A locator names a link::

    NAME/ADDRESS#key=value&key=value        evologics/serial:/dev/ttyUSB0#baudrate=19200
"""

import argparse
from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Final

import msgspec

from zacoustic.errors import ConfigError, LinkUnavailableError, ZacousticError
from zacoustic.link.command import Command
from zacoustic.link.contract import LINK_API, Link, convert_config
from zacoustic.text.installing import OURSELVES

LINK_GROUP: Final = "zacoustic.links"
"""Entry-point group of links: name → subclass of `Link`."""
COMMAND_GROUP: Final = "zacoustic.commands"
"""Entry-point group of verbs: name → subclass of `Command`; `GROUP.NAME` is a sub-verb of GROUP."""

_OURS: Final = "zacoustic"
"""The distribution of our own links."""


class Locator(msgspec.Struct, frozen=True):
    """The parts of a locator; the link defines the meaning of address and settings."""

    name: str
    """Name of the link."""
    address: str
    """The text between `NAME/` and `#`."""
    settings: dict[str, str]
    """The settings after `#`, as text."""


class LinkDescription(msgspec.Struct, frozen=True, kw_only=True):
    """One installed link, for `zacoustic links`."""

    name: str
    """Name in the locator."""
    package: str
    """Distribution that has it, and its version."""
    summary: str = ""
    """First line of the class's docstring; empty if it cannot be imported."""
    settings: dict[str, str] = {}
    """Settings of the locator with their defaults as text, or `required`."""
    error: str = ""
    """Why it is not usable; empty if it is."""


def parse_locator(locator: str) -> Locator:
    """Split a locator into its parts.

    Raises:
        ConfigError: The locator has no name, or a setting is not `key=value` or is given twice.
    """
    head, _, tail = locator.partition("#")
    name, slash, address = head.partition("/")
    if not (name and slash):
        raise ConfigError(
            f"locator {locator!r} names no link",
            hint="write NAME/ADDRESS#key=value, such as sim/127.0.0.1:7000",
        )
    settings: dict[str, str] = {}
    for item in tail.split("&") if tail else ():
        key, equals, value = item.partition("=")
        if not (key and equals):
            raise ConfigError(f"locator {locator!r}: setting {item!r} is not key=value")
        if key in settings:
            raise ConfigError(f"locator {locator!r}: setting {key!r} is given twice")
        settings[key] = value
    return Locator(name, address, settings)


def names() -> list[str]:
    """Return the names of all installed links, sorted; import none."""
    return sorted({point.name for point in metadata.entry_points(group=LINK_GROUP)})


def load(name: str) -> type[Link]:
    """Import the class of a link.

    Raises:
        LinkUnavailableError: The link is not installed, not importable, not a `Link`, or written
            for another version of the contract.
    """
    points = metadata.entry_points(group=LINK_GROUP, name=name)
    if not points:
        installed = names()
        if not installed:
            raise LinkUnavailableError("no links are installed", hint=OURSELVES)
        raise LinkUnavailableError(f"no link {name!r}; installed: {', '.join(installed)}")
    point = next(iter(points))
    loaded = _import(point, f"link {name!r}")
    if not (isinstance(loaded, type) and issubclass(loaded, Link)):
        raise LinkUnavailableError(f"link {name!r}: {point.value} is not a subclass of Link")
    if loaded.link_api != LINK_API:
        raise LinkUnavailableError(
            f"link {name!r} was written for link contract {loaded.link_api}, this is {LINK_API}",
            hint=f"upgrade both: pip install --upgrade {_distribution(point)}; {OURSELVES}",
        )
    return loaded


def create(locator: str, node_address: int) -> Link:
    """Create the link that a locator names; it is not open yet.

    Args:
        locator: `NAME/ADDRESS#key=value&key=value`.
        node_address: Acoustic address of this node, 1…254.

    Raises:
        ConfigError: The locator, its address or a setting is wrong.
        LinkUnavailableError: There is no such link, or it is not usable.
    """
    parts = parse_locator(locator)
    link_type = load(parts.name)
    config = convert_config(link_type.config_type, parts.settings, source=locator)
    return link_type.from_locator(parts.address, config, node_address=node_address)


def describe() -> list[LinkDescription]:
    """Describe all installed links, sorted; an unusable one by its error."""
    return [_describe(name) for name in names()]


def commands() -> Mapping[str, Command]:
    """Return all installed verbs by name, sorted; a look-up imports the verb.

    An unusable verb is an `UnavailableCommand`.
    """
    points = sorted(metadata.entry_points(group=COMMAND_GROUP), key=lambda point: point.name)
    return _InstalledCommands({point.name: point for point in points})


class _InstalledCommands(Mapping[str, Command]):
    """Verbs that are imported on look-up."""

    def __init__(self, points: Mapping[str, metadata.EntryPoint]) -> None:
        self._points = points

    def __getitem__(self, name: str) -> Command:
        return _load_command(self._points[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._points)

    def __len__(self) -> int:
        return len(self._points)


class UnavailableCommand(Command):
    """An installed verb that cannot be imported; with it, all others still work."""

    def __init__(self, name: str, error: ZacousticError) -> None:
        # Set on the instance, not on the class: each one is another verb.
        self.name = name  # type: ignore[misc]
        self.summary = f"not available: {error}"  # type: ignore[misc]
        self.error = error

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Accept any arguments, so that the user sees the import error first."""
        parser.add_argument("ignored", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)

    def run(self, arguments: argparse.Namespace) -> int:
        """Raise the error that says why the verb is not usable."""
        raise self.error


def _load_command(point: metadata.EntryPoint) -> Command:
    try:
        loaded = _import(point, f"command {point.name!r}")
        if not (isinstance(loaded, type) and issubclass(loaded, Command)):
            raise LinkUnavailableError(f"command {point.name!r}: {point.value} is not a Command")
    except ZacousticError as error:
        return UnavailableCommand(point.name, error)
    return loaded()


def _import(point: metadata.EntryPoint, what: str) -> object:
    """Import the object of an entry point; an error names the package to install."""
    try:
        loaded: object = point.load()
    except ImportError as error:
        needs = f"needs {error.name}" if error.name else f"cannot be imported: {error}"
        raise LinkUnavailableError(f"{what} {needs}", hint=_install_hint(point)) from error
    except AttributeError as error:
        raise LinkUnavailableError(f"{what}: {point.value} does not exist: {error}") from error
    except Exception as error:  # a fault of this package must not disable the others
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise LinkUnavailableError(f"{what}: {point.value} cannot be imported: {reason}") from error
    return loaded


def _install_hint(point: metadata.EntryPoint) -> str:
    """Return how to install what an entry point needs: by convention an extra of its name."""
    distribution = _distribution(point)
    if distribution == _OURS:  # our own links need nothing that is not always installed
        return OURSELVES
    return f"pip install {distribution}[{point.name.rpartition('.')[2]}]"


def _describe(name: str) -> LinkDescription:
    point = next(iter(metadata.entry_points(group=LINK_GROUP, name=name)))
    package = f"{_distribution(point)} {point.dist.version if point.dist else ''}".rstrip()
    try:
        link_type = load(name)
    except LinkUnavailableError as error:
        return LinkDescription(name=name, package=package, error=str(error))
    summary = (link_type.__doc__ or "").strip().partition("\n")[0]
    settings = {
        field.encode_name: "required" if field.required else _default(field)
        for field in msgspec.structs.fields(link_type.config_type)
    }
    return LinkDescription(name=name, package=package, summary=summary, settings=settings)


def _default(field: msgspec.structs.FieldInfo) -> str:
    """Return the default value as written in a locator."""
    if field.default is not msgspec.NODEFAULT:
        default = field.default
    else:
        default = field.default_factory()
    return str(default).lower() if isinstance(default, bool) else str(default)


def _distribution(point: metadata.EntryPoint) -> str:
    return point.dist.name if point.dist else _OURS
