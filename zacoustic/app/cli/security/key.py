"""The verbs `zacoustic key`: make, show, rotate and check the key of a fleet."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

from zacoustic.app.cli.support.printing import print_json, print_note
from zacoustic.app.cli.support.rows import (
    check_within,
    flag,
    node_address,
    option,
    seconds,
    whole,
    word,
)
from zacoustic.app.cli.support.verb import NetworkVerb, NodeFileVerb, Verb
from zacoustic.core.base.clock import SHORTEST_S
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK

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


class KeyVerb(Verb):
    """A verb about the file of a key, or of the list of members."""

    prints_late = False

    key: Path = word("KEYFILE", "the key file, or the list of members", type=Path)

    def show_file(self, path: Path, key: "FleetKey | Members") -> None:
        """Print what the file of a key or of members is, without secrets."""
        from zacoustic.app.tools.security.keyreport import as_text, report_on

        self.show(report_on(path, key), as_text)


class New(KeyVerb):
    r"""Make the key of a new fleet.

    copy the file to each node by cable or by hand, never by mail; anybody who can read
    it can read and command the fleet

    Examples:
      zacoustic key new fleet.key --network harbour
      zacoustic key new keys/auv1.identity --network harbour --identity 2 \
          --members keys/fleet.members
    """

    key: Path = word("KEYFILE", "the file to make", type=Path)
    network: str = option(
        "NAME",
        "name of the network: fleets with other names do not open each other's frames",
        required=True,
    )
    force: bool = flag("in place of a key that is there: that is lost")
    identity: int | None = whole(
        "ADDRESS", "not a key of the fleet, but one of this node alone; with --members"
    )
    members: Path | None = option("LIST", "the list that its public half is put on", type=Path)

    def work(self) -> None:
        """Make it, and print its fingerprint.

        Raises:
            ConfigError: There is one already, or it cannot be written.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.keys import new_key, write_key

        if self.identity is not None and self.members is not None:
            if self.force:
                raise ConfigError("--force; allowed: not with --identity")
            listed = members.enrol(self.key, self.members, self.network, self.identity)
            self.show_file(self.members, listed)
        elif self.identity is not None or self.members is not None:
            raise ConfigError("--identity and --members; allowed: both or none of them")
        else:
            key = new_key(self.network, after=self._generation())
            write_key(self.key, key, replace=self.force)
            self.show_file(self.key, key)

    def _generation(self) -> int:
        """Return the generation of a replaced key; −1: there is none, or of another network."""
        from zacoustic.seal.keys import KeyFileError, read_key

        if not self.force:
            return -1
        try:
            key = read_key(self.key)
        except KeyFileError:
            return -1
        return key.generation if key.network == self.network else -1


class Show(KeyVerb):
    """Print network, generation and fingerprint of a key, never the key.

    Example:
      zacoustic key show fleet.key
    """

    def work(self) -> None:
        """Print it.

        Raises:
            ConfigError: The file cannot be used.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.identities import read_members
        from zacoustic.seal.keys import read_key

        read = read_members if members.is_list(self.key) else read_key
        self.show_file(self.key, read(self.key))


class Rotate(KeyVerb):
    """Make the next generation of a key, which still opens frames of this one.

    do it once, on land, and copy the file to the vehicles first and to the shore last:
    who has the old file is not read by it, but is read, so commands of the shore reach
    every vehicle all the time

    Example:
      zacoustic key rotate fleet.key
    """

    end_overlap: bool = flag(
        "no new generation: take the former one out of the file, when all nodes have this"
    )

    def work(self) -> None:
        """Rewrite the file, and print the fingerprint.

        Raises:
            ConfigError: The file cannot be used, or there is no next generation.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.keys import read_key, write_key

        path = self.key.resolve()  # the target of a symbolic link
        if members.is_list(path):
            self.show_file(self.key, members.rotate(path, end_overlap=self.end_overlap))
            return
        key = read_key(path)
        if self.end_overlap and key.former is None:
            raise ConfigError(f"{self.key}: has no former generation; allowed: leave it")
        key = key.settled() if self.end_overlap else key.rotated()
        write_key(path, key, replace=True)
        self.show_file(self.key, key)


class Revoke(KeyVerb):
    """Shut a lost node out: the next generation of a list of members, without it.

    identities that lie beside the list wrap their broadcasts for those that are left;
    copy the list to all of them. Until a node has it, it listens to the lost one

    Example:
      zacoustic key revoke keys/fleet.members 2
    """

    key: Path = word("LIST", "the list of members", type=Path)
    address: int = word("ADDRESS", "the lost node", type=int)

    def work(self) -> None:
        """Rewrite the list, and print the remaining nodes.

        Raises:
            ConfigError: The file cannot be used, or is a fleet key, which has no members.
        """
        from zacoustic.app.tools.security import members
        from zacoustic.seal.keys import read_key

        if members.is_list(self.key):
            self.show_file(self.key, members.revoke(self.key, self.address))
            return
        key = read_key(self.key)
        raise ConfigError(
            f"{self.key}: {key.network} has one key for all nodes; node {self.address} "
            "cannot be taken out of it",
            hint="`zacoustic key rotate`, and give the next key to all other nodes: those that "
            "are submerged listen to the lost one until they have it",
        )


class Rejoin(Verb):
    """Make the life record of a node that has none."""

    epilog = f"""{_DANGER}

examples:
  zacoustic key rejoin 2 --config fleet.json5 --never --yes      its first start
  zacoustic key rejoin 2 --config fleet.json5 --after 41 --yes   after a new disk
"""
    prints_late = False

    address: int = word("ADDRESS", "the node", type=int)
    config: str = option("FILE", "its configuration, with `security`", required=True)
    never: bool = flag("it has never transmitted with this key", either="known", required=True)
    after: int | None = whole("N", "its last known life", either="known")
    yes: bool = flag("that is so, and I know the danger")

    def work(self) -> None:
        """Make the record.

        Raises:
            ConfigError: --yes is missing, or a file is wrong.
            LifeError: There is a record that is not behind, or it cannot be written.
        """
        from zacoustic.config import read_config
        from zacoustic.seal.keyring import open_keyring

        config = read_config(self.config, address=self.address)
        if config.security is None:
            raise ConfigError(
                f"{self.config}: plugins.acoustic.security: is missing",
                hint="a node without a key has no lives",
            )
        ring = open_keyring(config.security, self.address)
        if not self.yes:
            for line in _DANGER.splitlines():
                print_note(line)
            raise ConfigError("--yes is missing; allowed: when you know that it is so")
        after = ring.lives.join(None if self.never else self.after)
        record = {"address": self.address, "generation": ring.key.generation, "after": after}
        if self.json:
            print_json(record)
        else:
            print_note(
                f"node {self.address}: its next start is a life after {after}, with "
                f"generation {ring.key.generation} of the key"
            )


class Check(NodeFileVerb):
    """Check key file, life records and journal of a node.

    run it as the user of the gateway, on its computer; nothing is changed, and nothing
    secret printed. Exits with 1 when something is wrong

    Example:
      zacoustic key check fleet.json5 --address 2 --fingerprint 5be0a3c1
    """

    prints_late = False

    fingerprint: str | None = option("HEX", "that of the other nodes: `zacoustic key show`")

    def work(self) -> int:
        """Print the faults.

        Raises:
            ConfigError: The configuration or an argument is wrong.
        """
        from zacoustic.app.tools.security.keycheck import as_text, check_keys
        from zacoustic.config import read_config
        from zacoustic.seal.keys import is_fingerprint

        wanted = None if self.fingerprint is None else self.fingerprint.lower()
        if wanted is not None and not is_fingerprint(wanted):
            raise ConfigError(
                f"--fingerprint {self.fingerprint}; allowed: eight hexadecimal digits"
            )
        check = check_keys(read_config(self.file, address=self.address), wanted)
        self.show(check, as_text)
        return EXIT_FAILED if check.findings else EXIT_OK


class Send(NetworkVerb):
    """Let a submerged node open the broadcasts of one that its list has no key for.

    with identities only. The gateway here sends one frame of 59 bytes, which only that
    node can read; it must open these broadcasts itself, and the node must execute its
    commands. Copy the list to the node when it is back: then it can also talk with the
    source alone

    Example:
      zacoustic key send --node 3 --source 5 --config shore.json5
    """

    node: int = node_address("the node that gets the key", required=True)
    source: int = node_address("the node whose broadcasts it is to open", required=True)
    timeout: float = seconds("how long to try, s", 120.0)

    async def work(self) -> None:
        """Send it, and print what it took.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError: There is no such node, no such key, or it is refused.
            CallTimeoutError: No answer comes in time.
        """
        from zacoustic.app.tools.field.asking import local_gateways
        from zacoustic.zenoh.requests.key import KEY, KeyAnswer, KeyAsked

        check_within("--timeout", self.timeout, SHORTEST_S, KEY.most_s, unit=" s")
        question = KeyAsked(source=self.source)
        async with local_gateways(self.fleet(), self.connect) as gateways:
            answer = await gateways.ask(KEY, self.node, question, self.timeout)
        self.show(answer, KeyAnswer.text)
