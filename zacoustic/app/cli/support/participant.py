"""How a verb takes part, on Zenoh or directly on a link, and the values of typed streams."""

import argparse
from typing import TYPE_CHECKING, Any

from zacoustic.app.cli.support.arguments import OBJECT_PER_LINE, add_connect, add_json
from zacoustic.app.cli.support.printing import print_line
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from zacoustic.core.streams.table import Stream
    from zacoustic.core.values.types import TypeSpec
    from zacoustic.zenoh.node import Node


def add_node_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare how a verb takes part: on Zenoh, or directly on a link."""
    where = parser.add_mutually_exclusive_group()
    add_connect(where)
    where.add_argument("--link", metavar="LOCATOR", help="straight on a link; needs --config")
    parser.add_argument("--config", metavar="FILE", help="file with the section plugins.acoustic")
    parser.add_argument(
        "--address", type=int, metavar="N", help="acoustic address, instead of the file's"
    )
    add_json(parser, OBJECT_PER_LINE)


def make_node(arguments: argparse.Namespace) -> "Node":
    """Make the node described by the arguments; it is not open yet.

    Raises:
        ConfigError: A link without a config.
    """
    from zacoustic.zenoh.node import Node

    if arguments.link is not None and arguments.config is None:
        raise ConfigError("--link needs --config FILE, which has the stream ids")
    return Node(
        "command line",
        config=arguments.config,
        link=arguments.link,
        connect=arguments.connect,
        address=arguments.address,
    )


def class_of(spec: "TypeSpec | None") -> type[bytes] | str:
    """Return the type argument of an endpoint: a name, or bytes without a type."""
    return bytes if spec is None else spec.name


def read_request(stream: "Stream", text: str, *, source: str) -> Any:  # noqa: ANN401 (of its type)
    """Read the request of a service or the goal of an action; empty: all fields have defaults.

    Args:
        stream: The service or the action.
        text: The text of the user.
        source: The argument, for errors.

    Raises:
        ConfigError: The type has no such value.
    """
    from zacoustic.zenoh.node.api.text import read_text

    return read_text(text or ("{}" if stream.type is not None else ""), stream.type, source=source)


def print_value(record: dict[str, Any], value: object, *, as_json: bool, told: str = "{}") -> None:
    """Print a value, for people in a line of its own.

    Args:
        record: Further members of the JSON object.
        value: The value.
        as_json: Print a JSON object.
        told: The line for people, with a place for the value.
    """
    from zacoustic.zenoh.node.api.text import line_of, shown_value

    shown = shown_value(value, "")
    print_line({**record, **shown}, told.replace("{}", line_of(shown)), as_json=as_json)
