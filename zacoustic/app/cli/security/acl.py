"""The verb `zacoustic acl`."""

from typing import Any

from zacoustic.app.cli.support.rows import option, repeated
from zacoustic.app.cli.support.verb import NodeFileVerb


class Acl(NodeFileVerb):
    """Print Zenoh's access control for the local network, from the stream table.

    all that the table does not allow is denied: a program cannot publish or answer for
    a remote node, only an operator commands one, and programs' own keys need --open.
    Put the output into the file of the router; Zenoh reads it at its start

    Examples:
      zacoustic acl router.json5 --program planner --program camera --operator console
      zacoustic acl router.json5 --by interfaces --operator lo --open 'robot/**'
    """

    prints_late = False

    beside: list[int] = repeated("N", "another node on the same network", type=int)
    by: str = option(
        None,
        "what the names below are (default: %(default)s, with the settings of TLS)",
        "certificates",
        choices=("certificates", "users", "interfaces"),
    )
    program_: list[str] = repeated("NAME", "a program (default: anybody)")
    operator: list[str] = repeated("NAME", "who commands remote nodes (default: all programs)")
    gateway: list[str] = repeated("NAME", "a gateway that is a client of the router")
    open: list[str] = repeated("EXPRESSION", "keys that are the programs' own, such as robot/**")

    def work(self) -> None:
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

        config = read_config(self.file, address=self.address)
        names = Names(
            by=KnownBy(self.by),
            programs=tuple(self.program_),
            operators=tuple(self.operator),
            gateways=tuple(self.gateway),
        )
        settings: dict[str, Any] = access_settings(
            config, names, beside=tuple(self.beside), opened=tuple(self.open)
        )
        self.show(settings, as_text)
