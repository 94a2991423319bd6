"""The verb `zacoustic topic bw`: the bytes of a topic on the channel."""

import argparse
import asyncio
from typing import TYPE_CHECKING, Final

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.printing import print_line, print_note
from zacoustic.app.cli.watch.topics import add_watch_arguments, chosen, make_watch
from zacoustic.errors import DeliveryError
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT, Command
from zacoustic.link.serving import run_until_stopped

if TYPE_CHECKING:
    from zacoustic.app.tools.watch.watching import Watch

_EXAMPLE: Final = """Bytes are those that gateways here transmit for it, with headers,
acknowledgements and repeats; a gateway that only receives it transmits
only its acknowledgements. It costs no airtime.

examples:
  zacoustic topic bw auv1/nav --connect tcp/127.0.0.1:7447
  zacoustic topic bw auv1/nav --config router.json5 --node 2 --timeout 60 --json
"""


class BwCommand(Command):
    """Measures the bytes of a topic on the channel."""

    name = "bw"
    summary = "how many bytes of the channel a topic takes: per second, per sample"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the topic, gateways, their network, periods and the form of the output."""
        parser.epilog = _EXAMPLE
        parser.add_argument("stream", metavar="TOPIC", help="name or stream id")
        add_watch_arguments(parser)
        parser.add_argument(
            "--interval", type=float, default=10.0, metavar="S",
            help="time between two lines, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--timeout", type=float, metavar="S",
            help="end after this time, s; exit code 3 when nothing was transmitted",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Print until the time is over, or Ctrl-C.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: No gateway is there, or none has the topic.
        """
        check_positive(arguments, "interval", "timeout")
        return run_until_stopped(lambda stop: _measure(arguments)) or EXIT_OK


async def _measure(arguments: argparse.Namespace) -> int:
    loop = asyncio.get_running_loop()
    async with make_watch(arguments) as watch:
        first = last = _counts(watch, arguments)
        began = then = loop.time()
        end = float("inf") if arguments.timeout is None else began + arguments.timeout
        while loop.time() < end:
            await asyncio.sleep(min(arguments.interval, end - loop.time()))
            await watch.ask()
            counts, now = _counts(watch, arguments), loop.time()
            _print(arguments, _less(counts, last), now - then)
            last, then = counts, now
    if last == first:
        print_note(f"zacoustic topic bw: nothing transmitted within {arguments.timeout:g} s")
        return EXIT_TIMED_OUT
    return EXIT_OK


def _counts(watch: "Watch", arguments: argparse.Namespace) -> tuple[int, int]:
    """Return the bytes and records that the gateways have transmitted so far.

    Raises:
        DeliveryError: No gateway is there, or none has the topic.
    """
    from zacoustic.app.tools.watch.streaminfo import stream_in

    found = [stream_in(view.streams, arguments.stream) for view in chosen(watch, arguments.node)]
    streams = [stream for stream in found if stream is not None]
    if not streams:
        raise DeliveryError(
            f"no gateway here has a stream {arguments.stream}", hint="see zacoustic topic list"
        )
    return sum(each.airtime_bytes for each in streams), sum(each.sent for each in streams)


def _less(counts: tuple[int, int], before: tuple[int, int]) -> tuple[int, int]:
    """Return what was added; a restarted gateway counts from 0."""
    return max(0, counts[0] - before[0]), max(0, counts[1] - before[1])


def _print(arguments: argparse.Namespace, added: tuple[int, int], seconds: float) -> None:
    size_bytes, records = added
    rate = size_bytes / seconds
    each = size_bytes / records if records else None
    record = {
        "stream": arguments.stream,
        "bytes": size_bytes,
        "samples": records,
        "bytes_per_s": round(rate, 3),
        "bytes_per_sample": None if each is None else round(each, 3),
        "over_s": round(seconds, 3),
    }
    of_each = "" if each is None else f", {each:.1f} B each"
    text = f"{rate:.2f} B/s: {records} records{of_each}, within {seconds:.0f} s"
    print_line(record, text, as_json=arguments.json)
