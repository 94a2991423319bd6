"""Arguments shared by several verbs, each defined once."""

import argparse
from typing import TYPE_CHECKING, Final

from zacoustic.core.base.clock import DURATIONS, LONGEST_S, SHORTEST_S, is_duration
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from zacoustic.app.tools.field.doctor.doctor import Options

DEFAULT_WINDOW_S: Final = 10.0
"""Time within which samples usually share a frame, s."""

ONE_OBJECT: Final = "one JSON object"
OBJECT_PER_LINE: Final = "one JSON object per line"

_Adds = argparse.ArgumentParser | argparse._ArgumentGroup | argparse._MutuallyExclusiveGroup


def add_node_file(parser: argparse.ArgumentParser) -> None:
    """Declare FILE of a node, and its overrides."""
    parser.add_argument("file", metavar="FILE", help="Zenoh config with plugins.acoustic")
    parser.add_argument(
        "--address", type=int, metavar="N", help="address of this node, instead of the file's"
    )
    parser.add_argument(
        "--link", metavar="LOCATOR", help="the modem, instead of the file's: NAME/ADDRESS"
    )


def add_connect(parser: _Adds) -> None:
    """Declare where Zenoh is joined."""
    parser.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help="Zenoh endpoint, tcp/HOST:PORT"
    )


def add_examined_node(parser: argparse.ArgumentParser) -> None:
    """Declare a node to examine on its own computer."""
    add_node_file(parser)
    parser.add_argument(
        "--connect", action="append", default=[], metavar="ENDPOINT",
        help="Zenoh router of the gateway, instead of the file's; may be given again",
    )  # fmt: skip
    parser.add_argument(
        "--ntp", metavar="HOST[:PORT]", help="ask this time server how wrong the clock is"
    )


def examined_node(arguments: argparse.Namespace) -> "Options":
    """Return the arguments of `add_examined_node`."""
    from zacoustic.app.tools.field.doctor.doctor import Options

    return Options(
        address=arguments.address,
        locator=arguments.link,
        connect=tuple(arguments.connect),
        ntp=arguments.ntp,
    )


def add_local_network(parser: argparse.ArgumentParser) -> None:
    """Declare where Zenoh is joined, for a verb that needs no streams of a file."""
    add_connect(parser)
    parser.add_argument("--config", metavar="FILE", help="file with the endpoints of the router")


def add_load(parser: argparse.ArgumentParser, *, recording: str, profile: str) -> None:
    """Declare rates and modem.

    Args:
        parser: Takes them.
        recording: Purpose of a recording.
        profile: Purpose of the modem profile.
    """
    parser.add_argument(
        "--recording", action="append", default=[], metavar="RECORDING",
        help=f"{recording}; may be given again",
    )  # fmt: skip
    add_profile(parser, profile)


def add_profile(parser: argparse.ArgumentParser, what: str) -> None:
    """Declare a modem profile."""
    parser.add_argument(
        "--profile", metavar="NAME", help=f"modem{what} (default: the EvoLogics 18/34)"
    )


def add_telemetry(parser: argparse.ArgumentParser, *, config: str, window: str) -> None:
    """Declare recordings of telemetry, the streams, and the time whose samples share a frame.

    Args:
        parser: Takes them.
        config: Description of the file.
        window: Description of the time.
    """
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+",
        help='MCAP, or JSON lines, also compressed: {"t": seconds, "s": topic, "v": value}',
    )  # fmt: skip
    parser.add_argument("--config", metavar="FILE", required=True, help=f"file with {config}")
    parser.add_argument(
        "--window", type=float, default=DEFAULT_WINDOW_S, metavar="S",
        help=f"{window}, s (default: %(default)g)",
    )  # fmt: skip


def window_of(arguments: argparse.Namespace) -> float:
    """Return the time within which samples share a frame, s.

    Raises:
        ConfigError: It is not valid.
    """
    window_s: float = arguments.window
    if not is_duration(window_s):
        raise ConfigError(f"--window {window_s:g}; allowed: seconds, above 0, {DURATIONS}")
    return window_s


def add_json(parser: argparse.ArgumentParser, what: str = ONE_OBJECT) -> None:
    """Declare that results are printed as JSON."""
    parser.add_argument("--json", action="store_true", help=what)


def check_positive(arguments: argparse.Namespace, *names: str) -> None:
    """Check that numbers are above 0.

    Raises:
        ConfigError: One is not; names the argument and its value.
    """
    for name in names:
        value = getattr(arguments, name)
        if value is not None and not SHORTEST_S <= value <= LONGEST_S:
            limits = f"{SHORTEST_S:g}..{LONGEST_S:g}"
            raise ConfigError(f"--{name} {value}; allowed: above 0, {limits}")
