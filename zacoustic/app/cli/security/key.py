"""The verb `zacoustic key`: makes, shows, rotates and checks the key of a fleet."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Final

from zacoustic.app.cli.support.arguments import add_json, add_local_network
from zacoustic.app.cli.support.printing import print_json, print_note, print_result
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command, CommandGroup

if TYPE_CHECKING:
    from zacoustic.seal.identities import Members
    from zacoustic.seal.keys import FleetKey

_DANGER: Final = """\
Every frame of a node is sealed under a number that no other frame may have. The number begins with
the life of the node, and its records are gone: on another disk, in a copy, or deleted. If a life is
used a second time, anybody who has recorded both can read frames of both, and make others.
--never    says that no node with this address has ever transmitted with this key
--after N  says that N is the last life that anybody has heard of it: the other nodes show it, and
           `zacoustic key check` on the old disk
Who knows neither makes the next key, with which all lives begin anew: zacoustic key rotate"""


class KeyCommand(CommandGroup):
    """Keys of a fleet."""

    name = "key"

    def __init__(self) -> None:
        members = {
            member.name: member
            for member in (
                NewKey(), ShowKey(), RotateKey(), RevokeKey(), RejoinNode(), CheckKey(), SendKey()
            )
        }  # fmt: skip
        super().__init__(self.name, members, tuple(members))
        self.summary = "make, show, roll and check the key that seals frames"  # type: ignore[misc]


class NewKey(Command):
    """Makes a key."""

    name = "new"
    summary = "make the key of a new fleet"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file and network."""
        parser.add_argument("key", metavar="KEYFILE", type=Path, help="the file to make")
        parser.add_argument(
            "--network", metavar="NAME", required=True,
            help="name of the network: fleets with other names do not open each other's frames",
        )  # fmt: skip
        parser.add_argument(
            "--force", action="store_true", help="in place of a key that is there: that is lost"
        )
        parser.add_argument(
            "--identity", type=int, metavar="ADDRESS",
            help="not a key of the fleet, but one of this node alone; with --members",
        )  # fmt: skip
        parser.add_argument(
            "--members", type=Path, metavar="LIST", help="the list that its public half is put on"
        )
        add_json(parser)
        parser.epilog = (
            "copy the file to each node by cable or by hand, never by mail; anybody who can read\n"
            "it can read and command the fleet\n\n"
            "examples:\n"
            "  zacoustic key new fleet.key --network harbour\n"
            "  zacoustic key new keys/auv1.identity --network harbour --identity 2 \\\n"
            "      --members keys/fleet.members"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Make it, and print its fingerprint.

        Raises:
            ConfigError: There is one already, or it cannot be written.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.keys import new_key, write_key

        if (arguments.identity is None) != (arguments.members is None):
            raise ConfigError("--identity and --members; allowed: both or none of them")
        if arguments.identity is not None:
            if arguments.force:
                raise ConfigError("--force; allowed: not with --identity")
            listed = members.enrol(
                arguments.key, arguments.members, arguments.network, arguments.identity
            )
            return _print_members(arguments, arguments.members, listed)
        key = new_key(arguments.network, after=_generation(arguments))
        write_key(arguments.key, key, replace=arguments.force)
        return _print_key(arguments, key)


class ShowKey(Command):
    """Shows the present key without its secret."""

    name = "show"
    summary = "print network, generation and fingerprint of a key, never the key"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the file."""
        parser.add_argument(
            "key", metavar="KEYFILE", type=Path, help="the key file, or the list of members"
        )
        add_json(parser)
        parser.epilog = "example:\n  zacoustic key show fleet.key"

    def run(self, arguments: argparse.Namespace) -> int:
        """Print it.

        Raises:
            ConfigError: The file cannot be used.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.keys import read_key

        if members.is_list(arguments.key):
            from zacoustic.seal.identities import read_members

            return _print_members(arguments, arguments.key, read_members(arguments.key))
        return _print_key(arguments, read_key(arguments.key))


class RotateKey(Command):
    """Makes the next generation."""

    name = "rotate"
    summary = "make the next generation of a key, which still opens frames of this one"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the file, and whether the overlap ends."""
        parser.add_argument(
            "key", metavar="KEYFILE", type=Path, help="the key file, or the list of members"
        )
        parser.add_argument(
            "--end-overlap", action="store_true",
            help="no new generation: take the former one out of the file, when all nodes have this",
        )  # fmt: skip
        add_json(parser)
        parser.epilog = (
            "do it once, on land, and copy the file to the vehicles first and to the shore last:\n"
            "who has the old file is not read by it, but is read, so commands of the shore reach\n"
            "every vehicle all the time\n\n"
            "example:\n  zacoustic key rotate fleet.key"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Rewrite the file, and print the fingerprint.

        Raises:
            ConfigError: The file cannot be used, or there is no next generation.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.keys import read_key, write_key

        path = arguments.key.resolve()  # the target of a symbolic link
        if members.is_list(path):
            listed = members.rotate(path, end_overlap=arguments.end_overlap)
            return _print_members(arguments, arguments.key, listed)
        key = read_key(path)
        if arguments.end_overlap and key.former is None:
            raise ConfigError(f"{arguments.key}: has no former generation; allowed: leave it")
        key = key.settled() if arguments.end_overlap else key.rotated()
        write_key(path, key, replace=True)
        return _print_key(arguments, key)


class RevokeKey(Command):
    """Excludes a lost node."""

    name = "revoke"
    summary = "shut a lost node out: the next generation of a list of members, without it"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file and node."""
        parser.add_argument("key", metavar="LIST", type=Path, help="the list of members")
        parser.add_argument("address", metavar="ADDRESS", type=int, help="the lost node")
        add_json(parser)
        parser.epilog = (
            "identities that lie beside the list wrap their broadcasts for those that are left;\n"
            "copy the list to all of them. Until a node has it, it listens to the lost one\n\n"
            "example:\n  zacoustic key revoke keys/fleet.members 2"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Rewrite the list, and print the remaining nodes.

        Raises:
            ConfigError: The file cannot be used, or is a fleet key, which has no members.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.keys import read_key

        if members.is_list(arguments.key):
            left = members.revoke(arguments.key, arguments.address)
            return _print_members(arguments, arguments.key, left)
        key = read_key(arguments.key)
        raise ConfigError(
            f"{arguments.key}: {key.network} has one key for all nodes; node {arguments.address} "
            "cannot be taken out of it",
            hint="`zacoustic key rotate`, and give the next key to all other nodes: those that "
            "are submerged listen to the lost one until they have it",
        )


class RejoinNode(Command):
    """Makes a missing life record."""

    name = "rejoin"
    summary = "make the life record of a node that has none"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare node, file, and the known life."""
        parser.add_argument("address", metavar="ADDRESS", type=int, help="the node")
        parser.add_argument(
            "--config", metavar="FILE", required=True, help="its configuration, with `security`"
        )
        known = parser.add_mutually_exclusive_group(required=True)
        known.add_argument(
            "--never", action="store_true", help="it has never transmitted with this key"
        )
        known.add_argument("--after", type=int, metavar="N", help="its last known life")
        parser.add_argument("--yes", action="store_true", help="that is so, and I know the danger")
        add_json(parser)
        parser.epilog = (
            f"{_DANGER}\n\n"
            "examples:\n"
            "  zacoustic key rejoin 2 --config fleet.json5 --never --yes      its first start\n"
            "  zacoustic key rejoin 2 --config fleet.json5 --after 41 --yes   after a new disk"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Make the record.

        Raises:
            ConfigError: --yes is missing, or a file is wrong.
            LifeError: There is a record that is not behind, or it cannot be written.
        """
        from zacoustic.config import read_config
        from zacoustic.seal.keyring import open_keyring

        config = read_config(arguments.config, address=arguments.address)
        if config.security is None:
            raise ConfigError(
                f"{arguments.config}: plugins.acoustic.security: is missing",
                hint="a node without a key has no lives",
            )
        ring = open_keyring(config.security, arguments.address)
        if not arguments.yes:
            for line in _DANGER.splitlines():
                print_note(line)
            raise ConfigError("--yes is missing; allowed: when you know that it is so")
        after = ring.lives.join(None if arguments.never else arguments.after)
        record = {"address": arguments.address, "generation": ring.key.generation, "after": after}
        if arguments.json:
            print_json(record)
        else:
            print_note(
                f"node {arguments.address}: its next start is a life after {after}, with "
                f"generation {ring.key.generation} of the key"
            )
        return EXIT_OK


class CheckKey(Command):
    """Checks key file, life records and journal against each other."""

    name = "check"
    summary = "check key file, life records and journal of a node"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, node and fingerprint."""
        parser.add_argument("file", metavar="FILE", help="Zenoh config with plugins.acoustic")
        parser.add_argument(
            "--address", type=int, metavar="N", help="address of this node, instead of the file's"
        )
        parser.add_argument(
            "--fingerprint", metavar="HEX", help="that of the other nodes: `zacoustic key show`"
        )
        add_json(parser)
        parser.epilog = (
            "run it as the user of the gateway, on its computer; nothing is changed, and nothing\n"
            "secret printed. Exits with 1 when something is wrong\n\n"
            "example:\n  zacoustic key check fleet.json5 --address 2 --fingerprint 5be0a3c1"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the faults.

        Raises:
            ConfigError: The configuration or an argument is wrong.
        """
        from zacoustic.app.tools.security.keycheck import as_text, check_keys
        from zacoustic.config import read_config
        from zacoustic.seal.keys import is_fingerprint

        wanted = None if arguments.fingerprint is None else arguments.fingerprint.lower()
        if wanted is not None and not is_fingerprint(wanted):
            raise ConfigError(
                f"--fingerprint {arguments.fingerprint}; allowed: eight hexadecimal digits"
            )
        config = read_config(arguments.file, address=arguments.address)
        check = check_keys(config, wanted)
        print_result(check, as_text, as_json=arguments.json)
        return EXIT_FAILED if check.findings else EXIT_OK


class SendKey(Command):
    """Delivers the key for one node's broadcasts to another node, across the channel."""

    name = "send"
    summary = "let a submerged node open the broadcasts of one that its list has no key for"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare both nodes, and where to ask."""
        parser.add_argument(
            "--node", type=int, metavar="N", required=True, help="the node that gets the key"
        )
        parser.add_argument(
            "--source", type=int, metavar="N", required=True,
            help="the node whose broadcasts it is to open",
        )  # fmt: skip
        add_local_network(parser)
        add_json(parser)
        parser.add_argument(
            "--timeout", type=float, metavar="S", default=120.0,
            help="how long to try, s (default: 120)",
        )  # fmt: skip
        parser.epilog = (
            "with identities only. The gateway here sends one frame of 59 bytes, which only that\n"
            "node can read; it must open these broadcasts itself, and the node must execute its\n"
            "commands. Copy the list to the node when it is back: then it can also talk with the\n"
            "source alone\n\n"
            "example:\n  zacoustic key send --node 3 --source 5 --config shore.json5"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Send it, and print what it took; exit code 3 without an answer in time.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError: There is no such node, no such key, or it is refused.
        """
        import asyncio

        from zacoustic.app.tools.field.asking import local_gateways
        from zacoustic.app.tools.fleetfile import read_fleet
        from zacoustic.zenoh.requests.key import KEY, KeyAnswer, KeyAsked

        for name in ("node", "source"):
            if not 1 <= getattr(arguments, name) <= 254:
                raise ConfigError(f"--{name} {getattr(arguments, name)}; allowed: 1..254")
        if not 0 < arguments.timeout <= KEY.most_s:
            allowed = f"above 0, at most {KEY.most_s:g}"
            raise ConfigError(f"--timeout {arguments.timeout:g}; allowed: {allowed}")
        config = None if arguments.config is None else read_fleet(arguments.config)

        async def send() -> KeyAnswer:
            question = KeyAsked(source=arguments.source)
            async with local_gateways(config, arguments.connect) as gateways:
                return await gateways.ask(KEY, arguments.node, question, arguments.timeout)

        print_result(asyncio.run(send()), KeyAnswer.text, as_json=arguments.json)
        return EXIT_OK


def _print_key(arguments: argparse.Namespace, key: "FleetKey") -> int:
    from zacoustic.app.tools.security.keyreport import as_text, report_on

    print_result(report_on(arguments.key, key), as_text, as_json=arguments.json)
    return EXIT_OK


def _print_members(arguments: argparse.Namespace, path: Path, listed: "Members") -> int:
    from zacoustic.app.tools.security import members

    print_result(members.report_on(path, listed), members.as_text, as_json=arguments.json)
    return EXIT_OK


def _generation(arguments: argparse.Namespace) -> int:
    """Return the generation of a replaced key; −1: there is none, or of another network."""
    from zacoustic.seal.keys import KeyFileError, read_key

    if not arguments.force:
        return -1
    try:
        key = read_key(arguments.key)
    except KeyFileError:
        return -1
    return key.generation if key.network == arguments.network else -1
