"""The verb `zacoustic topic echo`: prints the samples of a topic, or of all of them."""

import argparse
import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.participant import add_node_arguments, class_of, make_node
from zacoustic.app.cli.support.printing import print_line, print_note
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT, Command
from zacoustic.link.serving import run_until_stopped

if TYPE_CHECKING:
    from zacoustic.zenoh.node import Node, Sample

# Samples of each key that may wait while standard output is blocked.
_DEPTH: Final = 1024

_EXAMPLE = """examples:
  zacoustic topic echo auv1/nav --connect tcp/127.0.0.1:7447
  zacoustic topic echo --link sim/127.0.0.1:7000 --config fleet.json5 --count 1 --timeout 60 --json
"""


class SubCommand(Command):
    """Prints received samples."""

    name = "sub"
    summary = "print the samples of a topic, on Zenoh or straight on a link"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare key, where from, how many and how long."""
        parser.epilog = _EXAMPLE
        parser.add_argument(
            "key", metavar="KEY", nargs="?",
            help="topic of the config, or key expression; none: all topics",
        )  # fmt: skip
        add_node_arguments(parser)
        parser.add_argument("--count", type=int, metavar="N", help="end after N samples")
        parser.add_argument(
            "--timeout", type=float, metavar="S",
            help="end after this time, s; exit code 3 with fewer samples than --count or none",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Print until the number is reached, the time is over, or Ctrl-C."""
        check_positive(arguments, "count", "timeout")
        return run_until_stopped(lambda stop: _listen(arguments)) or EXIT_OK


async def _listen(arguments: argparse.Namespace) -> int:
    from zacoustic.zenoh.node.api.mailbox import Mailbox

    wanted, seen = arguments.count or 1, 0
    async with make_node(arguments) as node:
        # Printed here, not in callbacks, so that a reader that closes the pipe ends the verb.
        arrived: Mailbox[Sample[Any]] = Mailbox(_DEPTH)
        subscribe(node, arguments.key, lambda sample: arrived.put(sample, sample.key))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(arguments.timeout):
                while arguments.count is None or seen < wanted:
                    sample = await arrived.get()
                    assert sample is not None
                    _print(sample, as_json=arguments.json)
                    seen += 1
    if seen >= wanted:
        return EXIT_OK
    told = f"{seen} of {wanted} samples within {arguments.timeout:g} s"
    print_note(f"zacoustic topic echo: {told}")
    return EXIT_TIMED_OUT


def subscribe(node: "Node", key: str | None, take: "Callable[[Sample[Any]], None]") -> None:
    """Subscribe to a key, to all topics, or without a config to all keys."""
    from zacoustic.core.base.qos import Qos

    for name in _names(node, key):
        stream = node.find_stream(name)
        sample_type: Any = class_of(None if stream is None else stream.type)
        node.create_subscription(sample_type, name, take, Qos(depth=_DEPTH))


def _print(sample: "Sample[Any]", *, as_json: bool) -> None:
    from zacoustic.core.values.age import age_words
    from zacoustic.zenoh.node.api.text import line_of, shown_value

    shown = {} if sample.deleted else shown_value(sample.content, sample.encoding)
    notes = [f"from {sample.source}"] if sample.source is not None else []
    age_s = sample.age_s
    if age_s is not None:  # a latched one may have waited here
        age_s = round(age_s + (time.monotonic_ns() - sample.received_at) / 1e9, 3)
        notes += [age_words(age_s, sample.age_error_s)]
    note = f"  ({', '.join(notes)})" if notes else ""
    record = {
        "key": sample.key,
        **shown,
        "deleted": sample.deleted,
        "encoding": sample.encoding,
        "source": sample.source,
        "age_s": age_s,
        "age_error_s": sample.age_error_s,
        "unix_s": time.time(),
    }
    text = f"{sample.key}: {'deleted' if sample.deleted else line_of(shown)}{note}"
    print_line(record, text, as_json=as_json)


def _names(node: "Node", key: str | None) -> list[str]:
    """Return the keys to subscribe to: the given one, all topics, or without a config all keys."""
    if key is not None:
        return [key]
    names = node.topics()
    told = ", ".join(names) if names else "every key"
    print_note(f"zacoustic topic echo: listening to {told}")
    return names or ["**"]
