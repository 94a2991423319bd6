"""The verb `zacoustic config init`: a configuration from the traffic of a live network."""

import argparse
import os
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.arguments import add_profile
from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, Command

if TYPE_CHECKING:
    from zacoustic.app.tools.design.first.survey import Survey
    from zacoustic.app.tools.design.first.writing import Files, Side

_LONGEST_S: Final = 86_400.0
_NOT_IN_NAMES: Final = re.compile(r"[^A-Za-z0-9_-]+")

_EXAMPLE: Final = """Listen while everything runs as at sea: ranges, steps and rates are those that
were seen. Topics to which somebody here subscribes and nobody publishes are from the other side.

examples:
  zacoustic config init --connect tcp/127.0.0.1:7447 --listen-s 30 --output fleet.json5
  zacoustic config init --connect tcp/127.0.0.1:7447 --listen-s 30 --output auv1.json5 \\
    --peer shore.json5 --link evologics/tcp:192.168.0.209:9200 \\
    --peer-link evologics/tcp:192.168.0.210:9200
  zacoustic config init --connect tcp/127.0.0.1:7447 --peer-connect tcp/192.168.0.3:7447 \\
    --listen-s 30 --output auv1.json5 --peer shore.json5 --traffic traffic.json5
"""


class InitCommand(Command):
    """Listens to a network and writes an initial configuration."""

    name = "init"
    summary = "write a first configuration from the topics and types of a live Zenoh network"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare endpoint, time, file and form of the output."""
        parser.add_argument(
            "--connect", metavar="ENDPOINT",
            help="a router or a peer, tcp/HOST:7447 (default: the peers that multicast finds)",
        )  # fmt: skip
        parser.add_argument(
            "--listen-s", type=float, default=5.0, metavar="S",
            help="how long to listen, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--key", action="append", default=[], metavar="EXPRESSION",
            help="only topics that it covers (default: **); may be given again: keys with a chunk "
            "that begins with @ are covered by no wildcard",
        )  # fmt: skip
        parser.add_argument(
            "--packages", type=Path, metavar="FOLDER",
            help="definitions of ROS that do not ship: PACKAGE/msg/Name.msg, srv, action",
        )  # fmt: skip
        parser.add_argument(
            "--output", type=Path, metavar="FILE", help="a new file (default: standard output)"
        )
        parser.add_argument(
            "--peer", type=Path, metavar="FILE",
            help="a new file for the other side; the names of the nodes are those of the files",
        )  # fmt: skip
        parser.add_argument(
            "--traffic", type=Path, metavar="FILE",
            help="a new scenario with what was published, for zacoustic config plan and sim",
        )  # fmt: skip
        parser.add_argument(
            "--peer-connect", metavar="ENDPOINT", help="listen to the other side's network as well"
        )
        parser.add_argument(
            "--peer-listen", metavar="ENDPOINT",
            help="where the other side's gateway listens as a router, unless --peer-connect names "
            "one (default: tcp/127.0.0.1:7447, or 7448 if --connect is there)",
        )  # fmt: skip
        for side, whose, address in (("", "this", 1), ("peer-", "the other", 2)):
            parser.add_argument(
                f"--{side}link", metavar="LOCATOR", help=f"the modem of {whose} side: NAME/ADDRESS"
            )
            parser.add_argument(
                f"--{side}address", type=int, default=address, metavar="N",
                help=f"acoustic address of {whose} side (default: %(default)d)",
            )  # fmt: skip
        parser.add_argument(
            "--node", action="append", default=[], metavar="N:NAME", type=_node,
            help="a further node of the fleet, its address and name; may be given again",
        )  # fmt: skip
        add_profile(parser, " for which the intervals are")
        parser.add_argument(
            "--interactive", action="store_true", help="ask about each topic before writing"
        )
        parser.add_argument(
            "--json", action="store_true", help="one JSON object: what was seen, and the file"
        )
        parser.epilog = _EXAMPLE

    def run(self, arguments: argparse.Namespace) -> int:
        """Listen, and write.

        Raises:
            ConfigError: Nothing was published, or an argument is wrong.
            SessionError: No router answers.
        """
        from zacoustic.app.tools.design.first.asking import ask_about
        from zacoustic.app.tools.design.first.traffic import write_traffic
        from zacoustic.app.tools.design.first.writing import Side, write_files
        from zacoustic.channel.profiles import DEFAULT_PROFILE

        _check(arguments)
        with (
            new_file("--output", arguments.output) as file,
            new_file("--peer", arguments.peer) as peer_file,
            new_file("--traffic", arguments.traffic) as traffic_file,
        ):
            survey, peer = _listen(arguments)
            here = _side(arguments, "", arguments.output, "here")
            there = _side(arguments, "peer_", arguments.peer, "there")
            others = [Side(address=number, name=name) for number, name in arguments.node]
            profile = arguments.profile or DEFAULT_PROFILE
            files = write_files(
                survey,
                here=here,
                there=there,
                peer=peer,
                peer_listen=arguments.peer_listen,
                packages=arguments.packages,
                others=others,
                profile=profile,
                choose=ask_about if arguments.interactive else lambda drafts: drafts,
            )
            if file is not None:
                file.write(files.text.encode())
            if peer_file is not None:
                peer_file.write(files.peer_text.encode())
            if traffic_file is not None:
                config = os.path.relpath(arguments.output, arguments.traffic.parent)
                text = write_traffic(
                    files,
                    here=here,
                    there=there,
                    others=others,
                    config=Path(config).as_posix(),
                    profile=profile,
                )
                traffic_file.write(text.encode())
        if arguments.json:
            print_json(_seen(arguments, survey, files))
        elif arguments.output is None:
            print_text(files.text.removesuffix("\n"))
        else:
            _tell(arguments, files)
        return EXIT_OK


def _check(arguments: argparse.Namespace) -> None:
    if not 0 < arguments.listen_s <= _LONGEST_S:
        raise ConfigError(
            f"--listen-s {arguments.listen_s:g}; allowed: seconds, above 0, up to {_LONGEST_S:g}"
        )
    for name in ("address", "peer_address"):
        if not 1 <= getattr(arguments, name) <= 254:
            option = name.replace("_", "-")
            raise ConfigError(f"--{option} {getattr(arguments, name)}; allowed: 1..254")
    if arguments.address == arguments.peer_address:
        raise ConfigError(f"--peer-address {arguments.peer_address}; allowed: another address")
    if arguments.packages is not None and not arguments.packages.is_dir():
        raise ConfigError(f"--packages {arguments.packages}; allowed: a folder")
    if arguments.traffic is not None and arguments.output is None:
        raise ConfigError("--traffic; allowed: with --output, the file that it names")
    if arguments.interactive and not sys.stdin.isatty():
        raise ConfigError("--interactive; allowed: on a terminal")


def _node(written: str) -> tuple[int, str]:
    address, colon, name = written.partition(":")
    if not (colon and name and address.isascii() and address.isdigit()):
        raise argparse.ArgumentTypeError(f'"{written}"; allowed: N:NAME, such as 3:auv3')
    return int(address), name


def _listen(arguments: argparse.Namespace) -> "tuple[Survey, Survey | None]":
    """Listen to the network of this side, and at the same time to the other one's if it is there.

    Raises:
        SessionError: No router answers.
    """
    from zacoustic.app.tools.design.first.survey import survey_network

    expressions = arguments.key or ["**"]

    def survey(endpoint: str | None) -> "Survey":
        return survey_network(endpoint, listen_s=arguments.listen_s, expressions=expressions)

    if arguments.peer_connect is None:
        return survey(arguments.connect), None
    with ThreadPoolExecutor(1) as other:
        peer = other.submit(survey, arguments.peer_connect)
        return survey(arguments.connect), peer.result()


def _side(arguments: argparse.Namespace, head: str, file: Path | None, name: str) -> "Side":
    from zacoustic.app.tools.design.first.writing import Side

    stem = "" if file is None else _NOT_IN_NAMES.sub("_", file.stem)
    return Side(
        address=getattr(arguments, f"{head}address"),
        name=stem if arguments.peer is not None and stem else name,
        locator=getattr(arguments, f"{head}link"),
        folder=Path() if file is None else file.parent,
    )


def _seen(arguments: argparse.Namespace, survey: "Survey", files: "Files") -> dict[str, Any]:
    written = {draft.name: draft for draft in files.drafts}
    return {
        "topics": [
            {"key": topic.key, "samples": topic.samples, "rate_hz": topic.rate_hz,
             "encoding": topic.encoding, "smallest_bytes": topic.smallest_bytes,
             "largest_bytes": topic.largest_bytes}
            for topic in survey.topics
        ],
        "intervals_s": {name: draft.interval_s for name, draft in written.items()},
        "services": list(survey.services),
        "left_out": list(files.left_out),
        "digest": files.config.table.digest.hex(),
        "file": None if arguments.output is None else str(arguments.output),
        "text": files.text,
        "peer_text": files.peer_text,
    }  # fmt: skip


def _tell(arguments: argparse.Namespace, files: "Files") -> None:
    for reason in files.left_out:
        print_note(f"left out: {reason}")
    edits = files.text.count("EDIT:") + files.peer_text.count("EDIT:") * bool(arguments.peer)
    look = f"; look for EDIT ({edits}), then:" if edits else "; then:"
    paths = " and ".join(str(each) for each in (arguments.output, arguments.peer) if each)
    print_note(f"{paths}: {len(files.config.table)} streams{look}")
    print_note(f"  zacoustic config check {arguments.output}")
    print_note(f"  zacoustic config plan {arguments.traffic or arguments.output}")
