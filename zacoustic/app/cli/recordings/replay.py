"""The verb `zacoustic replay`: runs a recording again, exactly or with changes."""

import argparse
import asyncio
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.arguments import add_connect, add_json, check_positive
from zacoustic.app.cli.support.printing import print_json, print_result, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command
from zacoustic.link.serving import stopped_by_signals
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.app.tools.inspect.recordings.replaying.checking import CipherOf
    from zacoustic.app.tools.inspect.recordings.replaying.playing import Played


class ReplayCommand(Command):
    """Plays a recording back."""

    name = "replay"
    summary = "play a recording back: onto Zenoh, or into engines, byte for byte"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare recording, operation, and its options."""
        parser.add_argument(
            "recordings", metavar="FILE", nargs="+",
            help="recording, MCAP; with --what-if those of both ends",
        )  # fmt: skip
        _add_modes(parser)
        _add_changes(parser)
        _add_zenoh(parser)
        add_json(parser)
        parser.epilog = (
            "--check exits with 1 when anything differs. What a recorded node had published is\n"
            "put as it was, so a gateway on that network sends it; what came off the channel has\n"
            "the mark of a gateway, and is not sent again\n\n"
            "examples:\n"
            "  zacoustic replay trial.mcap --check\n"
            "  zacoustic replay trial.mcap --through fleet.json5\n"
            "  zacoustic replay shore.mcap auv1.mcap --what-if --add-loss 0.2\n"
            "  zacoustic replay trial.mcap --connect tcp/127.0.0.1:7447 --rate 10 --key 'auv1/**'"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Replay.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError: No router can be reached.
        """
        if arguments.what_if:
            return _what_if(arguments)
        if len(arguments.recordings) > 1:
            raise ConfigError("several recordings; allowed: with --what-if, or one")
        arguments.recording = arguments.recordings[0]
        if arguments.check:
            return _check(arguments)
        if arguments.through is not None:
            return _through(arguments)
        check_positive(arguments, "rate")
        played = asyncio.run(_play(arguments))
        return _print_played(arguments, played)


def _add_modes(parser: argparse.ArgumentParser) -> None:
    """Declare the operations."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--check",
        action="store_true",
        help="make every engine again and compare frames, events and timers, byte for byte; "
        "sealed ones take --config with `security`",
    )
    what.add_argument(
        "--through", metavar="CONFIG",
        help="the same inputs into engines of this configuration: which frames are others?",
    )  # fmt: skip
    what.add_argument(
        "--what-if",
        action="store_true",
        help="the recorded load on a simulated channel, as it was and another way",
    )


def _add_changes(parser: argparse.ArgumentParser) -> None:
    """Declare the changes of --what-if."""
    changes = parser.add_argument_group("another way, with --what-if; also --config")
    changes.add_argument(
        "--add-loss", type=float, default=0.0, metavar="SHARE",
        help="so much more of the frames is lost: 0.2 is 20 %% more",
    )  # fmt: skip
    changes.add_argument("--loss", type=float, metavar="SHARE", help="so much, whatever it was")
    changes.add_argument("--access", choices=("aloha", "carrier_sense", "delegated"))
    changes.add_argument("--codec", choices=("cbor", "packed", "dense"), help="of typed topics")
    changes.add_argument(
        "--scenario", metavar="FILE", help="the channel, instead of the measured one"
    )
    changes.add_argument("--seed", type=int, default=1, metavar="N", help="of the losses")


def _add_zenoh(parser: argparse.ArgumentParser) -> None:
    """Declare what is put on a Zenoh network, where, and how fast."""
    onto = parser.add_argument_group("onto a Zenoh network, the default")
    add_connect(onto)
    onto.add_argument(
        "--config", metavar="FILE",
        help="where the router is, and the keys of ROS topics; with --what-if: the streams "
        "and rules of all nodes",
    )  # fmt: skip
    onto.add_argument("--rate", type=float, default=1.0, metavar="R", help="how many times as fast")
    onto.add_argument("--fast", action="store_true", help="without waiting at all")
    onto.add_argument(
        "--key", action="append", default=[], metavar="EXPRESSION",
        help="only what this key expression covers; may be given several times",
    )  # fmt: skip
    onto.add_argument(
        "--node",
        type=int,
        metavar="N",
        help="samples of this node, in a recording of several engines",
    )


def _what_if(arguments: argparse.Namespace) -> int:
    from zacoustic.app.tools.inspect.recordings.whatif.changes import Wanted, what_if
    from zacoustic.app.tools.inspect.recordings.whatif.whatiftext import as_text

    for name in ("add_loss", "loss"):
        share = getattr(arguments, name)
        if share is not None and not -1 <= share <= 1:
            raise ConfigError(f"--{name.replace('_', '-')} {share:g}; allowed: a share, 0..1")
    names = ("add_loss", "loss", "config", "access", "codec", "scenario", "seed")
    wanted = Wanted(**{name: getattr(arguments, name) for name in names})
    found = what_if(arguments.recordings, wanted)
    print_result(found, as_text, as_json=arguments.json)
    return EXIT_OK


def _check(arguments: argparse.Namespace) -> int:
    import msgspec

    from zacoustic.app.tools.inspect.recordings.replaying.checking import check_recording
    from zacoustic.app.tools.inspect.recordings.replaying.checktext import as_text

    verdict = check_recording(arguments.recording, _cipher_of(arguments.config))
    if arguments.json:
        found = {**msgspec.to_builtins(verdict), "is_same": verdict.is_same}
        print_json(found)
    else:
        print_text(as_text(verdict))
    return EXIT_OK if verdict.is_same else EXIT_FAILED


def _cipher_of(path: str | None) -> "CipherOf | None":
    """Return a source of the nodes' keys, from a configuration; None: it names no key."""
    from zacoustic.app.tools.fleetfile import read_fleet
    from zacoustic.seal.keyring import open_keyring

    security = None if path is None else read_fleet(path).security
    if security is None:
        return None
    return lambda address: open_keyring(security, address).cipher


def _through(arguments: argparse.Namespace) -> int:
    from zacoustic.app.tools.inspect.recordings.replaying.checktext import otherwise_as_text
    from zacoustic.app.tools.inspect.recordings.replaying.otherwise import replay_through
    from zacoustic.app.tools.inspect.recordings.replaying.today import configs_for
    from zacoustic.run.recording.epochs import nodes_of

    configs = configs_for(arguments.through, nodes_of(arguments.recording))
    found = replay_through(arguments.recording, configs)
    print_result(found, otherwise_as_text, as_json=arguments.json)
    return EXIT_OK


async def _play(arguments: argparse.Namespace) -> "Played":
    from zacoustic.app.tools.fleetfile import read_fleet
    from zacoustic.app.tools.inspect.recordings.replaying.playing import play

    config = None if arguments.config is None else read_fleet(arguments.config)
    stop = asyncio.Event()
    with stopped_by_signals(stop):
        return await play(
            arguments.recording,
            config=config,
            connect=arguments.connect,
            rate=None if arguments.fast else arguments.rate,
            keys=arguments.key,
            node=arguments.node,
            stop=stop,
        )


def _print_played(arguments: argparse.Namespace, played: "Played") -> int:

    from zacoustic.app.tools.columns import align

    if arguments.json:
        print_json(played)
    else:
        rows = [(key, str(number)) for key, number in sorted(played.samples.items())]
        print_text(align(("key", "samples"), rows, right=("samples",)))
        for key, number in played.left_out.items():
            print_text(f"{one_line(key)}: {number} left out; --config has the keys of ROS topics")
    if not played.samples:
        raise ConfigError(f"{arguments.recording}: it has no samples that could be put")
    return EXIT_OK
