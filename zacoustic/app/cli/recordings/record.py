"""The verb `zacoustic record`: records a Zenoh network and its gateways into a file."""

import argparse
import asyncio
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.arguments import ONE_OBJECT, add_connect, add_json, check_positive
from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command
from zacoustic.link.serving import stopped_by_signals

if TYPE_CHECKING:
    from zacoustic.app.tools.inspect.recordings.zenohrecord import RecordedKeys


class RecordCommand(Command):
    """Records a Zenoh network."""

    name = "record"
    summary = "record topics, health and frames of running gateways, from any machine, as MCAP"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, network, keys and how long."""
        parser.add_argument("-o", "--output", required=True, metavar="FILE", help="the recording")
        parser.add_argument("--config", metavar="FILE", help="file with the topics and their types")
        add_connect(parser)
        parser.add_argument(
            "--key", action="append", default=[], metavar="EXPRESSION",
            help="record this key expression as well; may be given several times",
        )  # fmt: skip
        parser.add_argument("--for", type=float, metavar="S", help="end after this time, s")
        add_json(parser, f"{ONE_OBJECT} at the end")
        parser.epilog = (
            "records the topics of the config, the health documents @acoustic/** and the frames\n"
            "of every gateway on that network, until Ctrl-C. What a gateway does inside is in its\n"
            "own recording: zacoustic run gateway --record\n\n"
            "example:\n"
            "  zacoustic record -o trial.mcap --config fleet.json5 --connect tcp/192.168.0.2:7447"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Record until Ctrl-C or the end of the time.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError: No router can be reached.
        """
        check_positive(arguments, "for")
        found = asyncio.run(_record(arguments))
        _print(found, as_json=arguments.json)
        return EXIT_FAILED if found.failure else EXIT_OK


async def _record(arguments: argparse.Namespace) -> "RecordedKeys":
    from zacoustic.app.tools.fleetfile import read_fleet
    from zacoustic.app.tools.inspect.recordings.zenohrecord import record_network

    config = None if arguments.config is None else read_fleet(arguments.config)
    stop = asyncio.Event()
    with stopped_by_signals(stop), contextlib.ExitStack() as stack:
        if (duration_s := vars(arguments)["for"]) is not None:
            timer = asyncio.get_running_loop().call_later(duration_s, stop.set)
            stack.callback(timer.cancel)
        return await record_network(
            arguments.output,
            config=config,
            connect=arguments.connect,
            keys=arguments.key,
            stop=stop,
            ready=_tell,
        )


def _tell(path: Path, keys: Sequence[str]) -> None:
    print_note(f"zacoustic record: {', '.join(keys)} into {path}")


def _print(found: "RecordedKeys", *, as_json: bool) -> None:

    from zacoustic.app.tools.columns import align

    if as_json:
        print_json(found)
        return
    rows = [(key, str(number)) for key, number in found.messages.items()]
    print_text(align(("key", "samples"), rows, right=("samples",)))
    if found.gaps:
        print_text(
            f"the Zenoh router was gone {found.gaps} times: samples of those times are not recorded"
        )
    if found.dropped:
        print_text(f"{found.dropped} messages were dropped: the disk was too slow, or is full")
