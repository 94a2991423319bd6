"""The verb `zacoustic topic pub`: publishes a value."""

import argparse
import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.participant import add_node_arguments, class_of, make_node
from zacoustic.app.cli.support.printing import print_line, print_note
from zacoustic.errors import ConfigError, DeliveryError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, EXIT_TIMED_OUT, Command
from zacoustic.link.serving import run_until_stopped

if TYPE_CHECKING:
    from zacoustic.app.cli.support.progress import ProgressLine
    from zacoustic.app.tools.field.following import End, GatewayFollower
    from zacoustic.core.streams.table import Stream
    from zacoustic.zenoh.node import Delivery, Node

_EXAMPLE = """examples:
  zacoustic topic pub auv1/cmd '{ mode: "survey" }' --connect tcp/127.0.0.1:7447
  zacoustic topic pub auv1/cmd '{ mode: "survey" }' --link sim/127.0.0.1:7000 --config fleet.json5
  zacoustic topic pub auv1/map --file map.png --wait --timeout 3600 --connect tcp/127.0.0.1:7447
"""


class PubCommand(Command):
    """Publishes a value, once or repeatedly."""

    name = "pub"
    summary = "publish a value, on Zenoh or straight on a link"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare key, value, where to, how often."""
        parser.epilog = _EXAMPLE
        parser.add_argument("key", metavar="KEY", help="topic of the config, or key expression")
        parser.add_argument(
            "value", metavar="VALUE", nargs="?",
            help="JSON5 for a typed topic, otherwise a text",
        )  # fmt: skip
        parser.add_argument(
            "--file", metavar="FILE", help="instead of VALUE: its bytes, for a topic without a type"
        )
        add_node_arguments(parser)
        parser.add_argument(
            "--wait", action="store_true",
            help="wait until the last one has arrived everywhere (reliable topics), and show how "
            "far it is; exit code 1 when it ended otherwise",
        )  # fmt: skip
        parser.add_argument(
            "--rate", type=float, metavar="HZ", help="publish so often; until --count or Ctrl-C"
        )
        parser.add_argument("--count", type=int, metavar="N", help="publish N times")
        parser.add_argument(
            "--timeout", type=float, default=60.0, metavar="S",
            help="how long the last one may take to leave, or with --wait to arrive, s "
            "(default: %(default)g)",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Publish; on a link, wait until the last value has left.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError: With --wait, no gateway reports whether it has arrived.
        """
        check_positive(arguments, "rate", "count", "timeout")
        if (arguments.value is None) == (arguments.file is None):
            raise ConfigError("VALUE or --file FILE; allowed: one of the two")
        return run_until_stopped(lambda stop: _publish(arguments)) or EXIT_OK


async def _publish(arguments: argparse.Namespace) -> int:
    from zacoustic.app.cli.support.progress import ProgressLine
    from zacoustic.app.tools.field.following import shown as followed
    from zacoustic.zenoh.node.api.text import line_of, shown_value

    async with make_node(arguments) as node, _follower(node, arguments) as follower:
        stream = node.find_stream(arguments.key)
        sample_type: Any = class_of(None if stream is None else stream.type)
        value, encoding = _read_value(arguments, stream)
        publisher = node.create_publisher(sample_type, arguments.key)
        shown = shown_value(value, encoding or "")
        if arguments.file is not None:
            shown = {"file": arguments.file, "bytes": len(value)}
        delivery: Delivery | None = None
        async for _ in _beats(arguments.rate, arguments.count):
            delivery = publisher.publish(value, encoding=encoding)
            record = {"key": publisher.key, **shown, "unix_s": time.time()}
            print_line(record, f"{publisher.key}: {line_of(shown)}", as_json=arguments.json)
        try:
            with (
                AT_WORK.begin("zacoustic topic pub"),
                ProgressLine(publisher.key, as_json=arguments.json) as line,
            ):
                async with asyncio.timeout(arguments.timeout), followed(delivery, line.show):
                    await node.flush()
                    end = await _end(delivery, follower, line) if arguments.wait else None
                    if end is None and (unsent := _unsent(node, stream, delivery)):
                        print_note(f"zacoustic topic pub: {publisher.key}: {unsent}")
                        return EXIT_FAILED
        except TimeoutError:
            what = "arrived" if arguments.wait else "sent"
            text = f"not {what} within {arguments.timeout:g} s"
            print_note(f"zacoustic topic pub: {text}")
            return EXIT_TIMED_OUT
    if end is None:
        return EXIT_OK
    missing = f", missing at {', '.join(map(str, end.missing))}" if end.missing else ""
    detail = f" ({end.detail})" if end.detail else ""
    ending = {"event": "ended", "outcome": end.outcome, "detail": end.detail}
    record = {"key": publisher.key, **ending, "missing": end.missing}
    text = f"{publisher.key}: {end.outcome}{missing}{detail}"
    print_line(record, text, as_json=arguments.json)
    return EXIT_OK if end.outcome == "delivered" else EXIT_FAILED


def _unsent(node: "Node", stream: "Stream | None", delivery: "Delivery | None") -> str:
    """Return why a sample that no longer waits was not sent; empty: it was."""
    if delivery is not None and delivery.outcome is not None:
        outcome = delivery.outcome.value
        return "" if outcome == "delivered" else f"not delivered: {outcome}"
    expired = 0 if stream is None else node.expired().get(stream.stream_id, 0)
    return f"{expired} became too old before they could be sent" if expired else ""


def _read_value(arguments: argparse.Namespace, stream: "Stream | None") -> tuple[Any, str | None]:
    """Return the payload, and its encoding if it is not the stream's.

    Raises:
        ConfigError: The value or the file is wrong.
    """
    from zacoustic.zenoh.node.api.text import read_text, read_untyped

    if arguments.file is not None:
        if stream is not None and stream.type is not None:
            raise ConfigError(
                f"--file {arguments.file}: {arguments.key} has the type {stream.type.name}",
                hint="give a VALUE",
            )
        try:
            return Path(arguments.file).read_bytes(), None
        except OSError as error:
            raise ConfigError(f"--file {arguments.file}: {error.strerror}") from error
    if stream is None:
        return read_untyped(arguments.value, source="VALUE")
    return read_text(arguments.value, stream.type, source="VALUE"), None


@contextlib.asynccontextmanager
async def _follower(
    node: "Node", arguments: argparse.Namespace
) -> "AsyncIterator[GatewayFollower | None]":
    """Watch the gateway that forwards a topic, to wait for the outcome on Zenoh."""
    if not arguments.wait or arguments.link is not None:
        yield None
        return
    from zacoustic.app.tools.field.following import GatewayFollower
    from zacoustic.app.tools.fleetfile import read_fleet
    from zacoustic.app.tools.watch.watching import Watch

    config = None if arguments.config is None else read_fleet(arguments.config)
    stream = node.find_stream(arguments.key)
    async with Watch(config, arguments.connect) as watch:
        yield GatewayFollower(watch, arguments.key if stream is None else stream.name)


async def _end(
    delivery: "Delivery | None", follower: "GatewayFollower | None", line: "ProgressLine"
) -> "End":
    """Wait for the end of a sample.

    Raises:
        DeliveryError: No gateway will report it.
    """
    from zacoustic.app.tools.field.following import end_of

    if follower is not None:
        return await follower.end(line.show)
    if delivery is None:
        raise DeliveryError(
            "it is not reliable: nobody learns whether it has arrived",
            hint='reliability: "reliable" in its stream',
        )
    return await end_of(delivery)


async def _beats(rate_hz: float | None, count: int | None) -> AsyncIterator[None]:
    """Tick as often as the arguments say; late ticks are dropped."""
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
