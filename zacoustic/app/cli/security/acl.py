"""The verb `zacoustic acl`: Zenoh's access control for a local network, from the stream table."""

import argparse

from zacoustic.app.cli.support.arguments import add_json
from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.link.command import EXIT_OK, Command


class AclCommand(Command):
    """Prints settings for a router."""

    name = "acl"
    summary = "print Zenoh's access control for the local network, from the stream table"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, node, and the names of users."""
        parser.add_argument("file", metavar="FILE", help="Zenoh config with plugins.acoustic")
        parser.add_argument(
            "--address", type=int, metavar="N", help="address of this node, instead of the file's"
        )
        parser.add_argument(
            "--beside", type=int, action="append", default=[], metavar="N",
            help="another node on the same network; may be given again",
        )  # fmt: skip
        parser.add_argument(
            "--by", choices=("certificates", "users", "interfaces"), default="certificates",
            help="what the names below are (default: %(default)s, with the settings of TLS)",
        )  # fmt: skip
        for role, what in (
            ("program", "a program (default: anybody)"),
            ("operator", "who commands remote nodes (default: all programs)"),
            ("gateway", "a gateway that is a client of the router"),
        ):
            parser.add_argument(
                f"--{role}", action="append", default=[], metavar="NAME",
                help=f"{what}; may be given again",
            )  # fmt: skip
        parser.add_argument(
            "--open", action="append", default=[], metavar="EXPRESSION",
            help="keys that are the programs' own, such as robot/**; may be given again",
        )  # fmt: skip
        add_json(parser)
        parser.epilog = (
            "all that the table does not allow is denied: a program cannot publish or answer for\n"
            "a remote node, only an operator commands one, and programs' own keys need --open.\n"
            "Put the output into the file of the router; Zenoh reads it at its start\n\n"
            "examples:\n"
            "  zacoustic acl router.json5 --program planner --program camera --operator console\n"
            "  zacoustic acl router.json5 --by interfaces --operator lo --open 'robot/**'"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print them.

        Raises:
            ConfigError: The file is wrong, or a user lacks a required name.
        """
        from zacoustic.app.tools.security.access.rules import (
            KnownBy,
            Names,
            access_settings,
            as_text,
        )
        from zacoustic.config import read_config

        config = read_config(arguments.file, address=arguments.address)
        names = Names(
            by=KnownBy(arguments.by),
            programs=tuple(arguments.program),
            operators=tuple(arguments.operator),
            gateways=tuple(arguments.gateway),
        )
        settings = access_settings(
            config, names, beside=tuple(arguments.beside), opened=tuple(arguments.open)
        )
        if arguments.json:
            print_json(settings)
        else:
            print_text(as_text(settings))
        return EXIT_OK
