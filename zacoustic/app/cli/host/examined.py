"""The common part of verbs that examine a node on its own computer."""

from typing import TYPE_CHECKING

from zacoustic.app.cli.support.rows import option, repeated
from zacoustic.app.cli.support.verb import LinkedVerb

if TYPE_CHECKING:
    from zacoustic.app.tools.field.doctor.doctor import Options


class Examined(LinkedVerb):
    """A verb that examines a node."""

    connect: list[str] = repeated("ENDPOINT", "Zenoh router of the gateway, instead of the file's")
    ntp: str | None = option("HOST[:PORT]", "ask this time server how wrong the clock is")

    def options(self) -> "Options":
        """Return what to examine, and how."""
        from zacoustic.app.tools.field.doctor.doctor import Options

        connect = tuple(self.connect)
        return Options(address=self.address, locator=self.link, connect=connect, ntp=self.ntp)
