"""The verb `zacoustic config init`: a configuration from the traffic of a live network."""

import argparse
from pathlib import Path
from typing import Final

from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, Command

_LONGEST_S: Final = 86_400.0


class InitCommand(Command):
    """Listens to a network and writes an initial configuration."""

    name = "init"
    summary = "write a first configuration from the topics and types of a live Zenoh network"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare endpoint, time, file and form of the output."""
        parser.add_argument(
            "--connect", metavar="ENDPOINT", required=True, help="a router, tcp/HOST:7447"
        )
        parser.add_argument(
            "--listen-s", type=float, default=5.0, metavar="S",
            help="how long to listen, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--key", default="**", metavar="EXPRESSION", help="only topics it covers (default: **)"
        )
        parser.add_argument(
            "--output", type=Path, metavar="FILE", help="a new file (default: standard output)"
        )
        parser.add_argument(
            "--json", action="store_true", help="one JSON object: what was seen, and the file"
        )
        parser.epilog = (
            "example:\n"
            "  zacoustic config init --connect tcp/127.0.0.1:7447 --listen-s 30 \\\n"
            "    --output fleet.json5\n"
            "  zacoustic config check fleet.json5"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Listen, and write.

        Raises:
            ConfigError: Nothing was published, or an argument is wrong.
            SessionError: No router answers.
        """
        from zacoustic.app.tools.design.first.survey import survey_network
        from zacoustic.app.tools.design.first.writing import write_config

        listen_s, output = arguments.listen_s, arguments.output
        if not 0 < listen_s <= _LONGEST_S:
            raise ConfigError(
                f"--listen-s {listen_s:g}; allowed: seconds, above 0, up to {_LONGEST_S:g}"
            )
        with new_file("--output", output) as file:
            survey = survey_network(arguments.connect, listen_s=listen_s, expression=arguments.key)
            text, config = write_config(survey)
            if file is not None:
                file.write(text.encode())
        if arguments.json:
            seen = {
                "topics": [
                    {"key": topic.key, "samples": topic.samples, "rate_hz": topic.rate_hz,
                     "encoding": topic.encoding, "smallest_bytes": topic.smallest_bytes,
                     "largest_bytes": topic.largest_bytes}
                    for topic in survey.topics
                ],
                "services": list(survey.services),
                "digest": config.table.digest.hex(),
                "file": str(output) if output is not None else None,
                "text": text,
            }  # fmt: skip
            print_json(seen)
        elif output is None:
            print_text(text.removesuffix("\n"))
        else:
            print_note(f"{output}: {len(config.table)} streams; look for EDIT, then:")
            print_note(f"  zacoustic config check {output}")
        return EXIT_OK
