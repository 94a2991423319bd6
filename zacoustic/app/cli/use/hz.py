"""The verb `zacoustic topic hz`: how often samples of a topic arrive here."""

import argparse
import asyncio
import contextlib
from typing import TYPE_CHECKING, Final

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.participant import add_node_arguments, make_node
from zacoustic.app.cli.support.printing import print_line, print_note
from zacoustic.app.cli.use.sub import subscribe
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT, Command
from zacoustic.link.serving import run_until_stopped

if TYPE_CHECKING:
    from zacoustic.app.tools.field.rates import RateMeter

_EXAMPLE: Final = """It counts the samples that arrive on this network or link: behind a gateway,
those that have crossed; zacoustic topic list shows the rates of records on the channel.

examples:
  zacoustic topic hz auv1/nav --connect tcp/127.0.0.1:7447
  zacoustic topic hz auv1/nav --config router.json5 --window 20 --timeout 600 --json
"""


class HzCommand(Command):
    """Measures the rate of arriving samples."""

    name = "hz"
    summary = "how often samples of a topic arrive: mean, shortest and longest time between"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare key, where from, window and periods."""
        parser.epilog = _EXAMPLE
        parser.add_argument("key", metavar="KEY", help="topic of the config, or key expression")
        add_node_arguments(parser)
        parser.add_argument(
            "--window", type=int, default=100, metavar="N",
            help="how many of the last samples count (default: %(default)d)",
        )  # fmt: skip
        parser.add_argument(
            "--interval", type=float, default=5.0, metavar="S",
            help="time between two lines, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--timeout", type=float, metavar="S",
            help="end after this time, s; exit code 3 with less than two samples",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Print until the time is over, or Ctrl-C."""
        check_positive(arguments, "interval", "timeout")
        if not 2 <= arguments.window <= 1_000_000:
            raise ConfigError(f"--window {arguments.window}; allowed: 2..1000000")
        return run_until_stopped(lambda stop: _measure(arguments)) or EXIT_OK


async def _measure(arguments: argparse.Namespace) -> int:
    from zacoustic.app.tools.field.rates import RateMeter

    meter = RateMeter(arguments.window)
    loop = asyncio.get_running_loop()
    async with make_node(arguments) as node:
        subscribe(node, arguments.key, lambda sample: meter.note(loop.time()))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(arguments.timeout):
                while True:
                    await asyncio.sleep(arguments.interval)
                    _print(arguments, meter)
    _print(arguments, meter)
    if meter.rate() is not None:
        return EXIT_OK
    print_note(f"zacoustic topic hz: {meter.total} samples within {arguments.timeout:g} s")
    return EXIT_TIMED_OUT


def _print(arguments: argparse.Namespace, meter: "RateMeter") -> None:
    import msgspec

    rate = meter.rate()
    if rate is None:
        return
    text = (
        f"{rate.rate_hz:.3g}/s: {rate.min_s:.2f}..{rate.max_s:.2f} s between two, "
        f"deviation {rate.deviation_s:.2f} s, {rate.samples} samples"
    )
    record = {"key": arguments.key, **msgspec.to_builtins(rate), "total": meter.total}
    print_line(record, text, as_json=arguments.json)
