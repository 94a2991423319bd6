"""The verb `zacoustic config init`."""

import argparse
import os
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.app.cli.support.rows import flag, modem_profile, node_address, option, real, repeated
from zacoustic.app.cli.support.verb import Verb
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from zacoustic.app.tools.design.first.survey import Survey
    from zacoustic.app.tools.design.first.writing import Files, Side

_LONGEST_S: Final = 86_400.0
_NOT_IN_NAMES: Final = re.compile(r"[^A-Za-z0-9_-]+")


def _node(written: str) -> tuple[int, str]:
    address, colon, name = written.partition(":")
    if not (colon and name and address.isascii() and address.isdigit()):
        raise argparse.ArgumentTypeError(f'"{written}"; allowed: N:NAME, such as 3:auv3')
    return int(address), name


class Init(Verb):
    r"""Write a first configuration from the topics and types of a live Zenoh network.

    Listen while everything runs as at sea: ranges, steps and rates are those that
    were seen. Topics to which somebody here subscribes and nobody publishes are from the other side.

    Examples:
      zacoustic config init --connect tcp/127.0.0.1:7447 --listen-s 30 --output fleet.json5
      zacoustic config init --connect tcp/127.0.0.1:7447 --listen-s 30 --output auv1.json5 \
        --peer shore.json5 --link evologics/tcp:192.168.0.209:9200 \
        --peer-link evologics/tcp:192.168.0.210:9200
      zacoustic config init --connect tcp/127.0.0.1:7447 --peer-connect tcp/192.168.0.3:7447 \
        --listen-s 30 --output auv1.json5 --peer shore.json5 --traffic traffic.json5
    """  # noqa: E501 (wide on a terminal)

    connect: str | None = option(
        "ENDPOINT", "a router or a peer, tcp/HOST:7447 (default: the peers that multicast finds)"
    )
    listen_s: float = real("S", "how long to listen, s", 5.0, most=_LONGEST_S)
    key: list[str] = repeated(
        "EXPRESSION",
        "only topics that it covers (default: **); may be given again: keys with a chunk that "
        "begins with @ are covered by no wildcard",
    )
    packages: Path | None = option(
        "FOLDER",
        "definitions of ROS that do not ship: PACKAGE/msg/Name.msg, srv, action",
        type=Path,
    )
    output: Path | None = option("FILE", "a new file (default: standard output)", type=Path)
    peer: Path | None = option(
        "FILE",
        "a new file for the other side; the names of the nodes are those of the files",
        type=Path,
    )
    traffic: Path | None = option(
        "FILE",
        "a new scenario with what was published, for zacoustic config plan and sim",
        type=Path,
    )
    peer_connect: str | None = option("ENDPOINT", "listen to the other side's network as well")
    peer_listen: str | None = option(
        "ENDPOINT",
        "where the other side's gateway listens as a router, unless --peer-connect names one "
        "(default: tcp/127.0.0.1:7447, or 7448 if --connect is there)",
    )
    link: str | None = option("LOCATOR", "the modem of this side: NAME/ADDRESS")
    address: int = node_address("acoustic address of this side", 1)
    peer_link: str | None = option("LOCATOR", "the modem of the other side: NAME/ADDRESS")
    peer_address: int = node_address("acoustic address of the other side", 2)
    node: list[tuple[int, str]] = repeated(
        "N:NAME", "a further node of the fleet, its address and name", type=_node
    )
    profile: str | None = modem_profile(" for which the intervals are")
    interactive: bool = flag("ask about each topic before writing")
    json: bool = flag("one JSON object: what was seen, and the file")

    def work(self) -> None:
        """Listen, and write.

        Raises:
            ConfigError: Nothing was published, or an argument is wrong.
            SessionError: No router answers.
        """
        from zacoustic.app.tools.design.first.asking import ask_about
        from zacoustic.app.tools.design.first.traffic import write_traffic
        from zacoustic.app.tools.design.first.writing import Side, write_files
        from zacoustic.channel.profiles import DEFAULT_PROFILE

        self._check()
        with (
            new_file("--output", self.output) as file,
            new_file("--peer", self.peer) as peer_file,
            new_file("--traffic", self.traffic) as traffic_file,
        ):
            survey, peer = self._listen()
            here = self._side("", self.output, "here")
            there = self._side("peer_", self.peer, "there")
            others = [Side(address=number, name=name) for number, name in self.node]
            profile = self.profile or DEFAULT_PROFILE
            files = write_files(
                survey,
                here=here,
                there=there,
                peer=peer,
                peer_listen=self.peer_listen,
                packages=self.packages,
                others=others,
                profile=profile,
                choose=ask_about if self.interactive else lambda drafts: drafts,
            )
            if file is not None:
                file.write(files.text.encode())
            if peer_file is not None:
                peer_file.write(files.peer_text.encode())
            if traffic_file is not None and self.output and self.traffic:
                config = os.path.relpath(self.output, self.traffic.parent)
                text = write_traffic(
                    files,
                    here=here,
                    there=there,
                    others=others,
                    config=Path(config).as_posix(),
                    profile=profile,
                )
                traffic_file.write(text.encode())
        if self.json:
            print_json(self._seen(survey, files))
        elif self.output is None:
            print_text(files.text.removesuffix("\n"))
        else:
            self._tell(files)

    def _check(self) -> None:
        if self.address == self.peer_address:
            raise ConfigError(f"--peer-address {self.peer_address}; allowed: another address")
        if self.packages is not None and not self.packages.is_dir():
            raise ConfigError(f"--packages {self.packages}; allowed: a folder")
        if self.traffic is not None and self.output is None:
            raise ConfigError("--traffic; allowed: with --output, the file that it names")
        if self.interactive and not sys.stdin.isatty():
            raise ConfigError("--interactive; allowed: on a terminal")

    def _listen(self) -> "tuple[Survey, Survey | None]":
        """Listen to the network of this side, and at the same time to a given one of the other.

        Raises:
            SessionError: No router answers.
        """
        from zacoustic.app.tools.design.first.survey import survey_network

        expressions = self.key or ["**"]

        def survey(endpoint: str | None) -> "Survey":
            return survey_network(endpoint, listen_s=self.listen_s, expressions=expressions)

        if self.peer_connect is None:
            return survey(self.connect), None
        with ThreadPoolExecutor(1) as other:
            peer = other.submit(survey, self.peer_connect)
            return survey(self.connect), peer.result()

    def _side(self, head: str, file: Path | None, name: str) -> "Side":
        from zacoustic.app.tools.design.first.writing import Side

        stem = "" if file is None else _NOT_IN_NAMES.sub("_", file.stem)
        return Side(
            address=getattr(self, f"{head}address"),
            name=stem if self.peer is not None and stem else name,
            locator=getattr(self, f"{head}link"),
            folder=Path() if file is None else file.parent,
        )

    def _seen(self, survey: "Survey", files: "Files") -> dict[str, Any]:
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
            "file": None if self.output is None else str(self.output),
            "text": files.text,
            "peer_text": files.peer_text,
        }  # fmt: skip

    def _tell(self, files: "Files") -> None:
        for reason in files.left_out:
            print_note(f"left out: {reason}")
        edits = files.text.count("EDIT:") + files.peer_text.count("EDIT:") * bool(self.peer)
        look = f"; look for EDIT ({edits}), then:" if edits else "; then:"
        paths = " and ".join(str(each) for each in (self.output, self.peer) if each)
        print_note(f"{paths}: {len(files.config.table)} streams{look}")
        print_note(f"  zacoustic config check {self.output}")
        print_note(f"  zacoustic config plan {self.traffic or self.output}")
