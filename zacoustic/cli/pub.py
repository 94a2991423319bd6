"""The verb `zacoustic pub`, and the arguments that it shares with `sub` and `call`."""

import argparse
import asyncio
import contextlib
import json
import sys
import time
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any

from zacoustic.command import EXIT_OK, EXIT_TIMED_OUT, Command
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from zacoustic.node import Node

_EXAMPLE = """examples:
  zacoustic pub auv1/cmd '{ mode: "survey" }' --connect tcp/127.0.0.1:7447
  zacoustic pub auv1/cmd '{ mode: "survey" }' --link sim/127.0.0.1:7000 --config fleet.json5
"""


class PubCommand(Command):
    """Publishes a value, once or again and again."""

    name = "pub"
    summary = "publish a value, on Zenoh or straight on a link"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare key, value, where to, how often."""
        parser.epilog = _EXAMPLE
        parser.add_argument("key", metavar="KEY", help="topic of the config, or key expression")
        parser.add_argument(
            "value", metavar="VALUE", help="JSON5 for a typed topic, otherwise a text"
        )
        add_node_arguments(parser)
        parser.add_argument(
            "--rate", type=float, metavar="HZ", help="publish so often; until --count or Ctrl-C"
        )
        parser.add_argument("--count", type=int, metavar="N", help="publish so many times")
        parser.add_argument(
            "--timeout", type=float, default=60.0, metavar="S",
            help="how long the last one may take to leave, s (default: %(default)g)",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Publish; on a link, wait until the last value has left."""
        check_positive(arguments, "rate", "count", "timeout")
        with contextlib.suppress(KeyboardInterrupt):
            return asyncio.run(_publish(arguments))
        return EXIT_OK


async def _publish(arguments: argparse.Namespace) -> int:
    from zacoustic.node.text import line_of, read_text, read_untyped, shown_value

    async with make_node(arguments) as node:
        encoding: str | None = None
        stream = node.find_stream(arguments.key)
        sample_type: Any = bytes if stream is None or stream.type is None else stream.type.name
        if stream is None:
            value, encoding = read_untyped(arguments.value, source="VALUE")
        else:
            value = read_text(arguments.value, stream.type, source="VALUE")
        publisher = node.create_publisher(sample_type, arguments.key)
        shown = shown_value(value, encoding or "")
        async for _ in _beats(arguments.rate, arguments.count):
            publisher.publish(value, encoding=encoding)
            record = {"key": publisher.key, **shown, "unix_s": time.time()}
            print_line(record, f"{publisher.key}: {line_of(shown)}", as_json=arguments.json)
        try:
            await node.flush(timeout_s=arguments.timeout)
        except TimeoutError:
            print(f"zacoustic pub: not sent within {arguments.timeout:g} s", file=sys.stderr)
            return EXIT_TIMED_OUT
    return EXIT_OK


async def _beats(rate_hz: float | None, count: int | None) -> AsyncIterator[None]:
    """Tick as often as the arguments say; late ticks are not made up for."""
    left = count if count is not None else (1 if rate_hz is None else None)
    loop = asyncio.get_running_loop()
    due_at = loop.time()
    while left is None or left > 0:
        yield
        if left is not None:
            left -= 1
        if rate_hz is not None and left != 0:
            due_at = max(due_at + 1 / rate_hz, loop.time())
            await asyncio.sleep(due_at - loop.time())


def add_node_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare how a verb takes part: on Zenoh, or straight on a link."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--connect", action="append", metavar="ENDPOINT", help="Zenoh endpoint, tcp/HOST:PORT"
    )
    where.add_argument("--link", metavar="LOCATOR", help="straight on a link; needs --config")
    parser.add_argument("--config", metavar="FILE", help="file with the section plugins.acoustic")
    parser.add_argument(
        "--address", type=int, metavar="N", help="acoustic address, instead of the file's"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object per line")


def make_node(arguments: argparse.Namespace) -> "Node":
    """Make the node that the arguments describe; it is not open yet.

    Raises:
        ConfigError: A link without a config.
    """
    from zacoustic.node import Node

    if arguments.link is not None and arguments.config is None:
        raise ConfigError("--link needs --config FILE, which tells the stream ids")
    return Node(
        "command line",
        config=arguments.config,
        link=arguments.link,
        connect=arguments.connect,
        address=arguments.address,
    )


def check_positive(arguments: argparse.Namespace, *names: str) -> None:
    """Refuse numbers that are not above 0.

    Raises:
        ConfigError: Names the argument and its value.
    """
    for name in names:
        value = getattr(arguments, name)
        if value is not None and not 0 < value < float("inf"):
            raise ConfigError(f"--{name} {value}; allowed: above 0")


def print_line(record: dict[str, Any], text: str, *, as_json: bool) -> None:
    """Print one result at once: whoever reads a pipe wants each line when it happens."""
    print(json.dumps(record, ensure_ascii=False) if as_json else text, flush=True)
