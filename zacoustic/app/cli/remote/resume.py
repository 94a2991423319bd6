"""The verb `zacoustic resume`."""

from zacoustic.app.cli.remote.commanding import Commanding, make_command


class Resume(Commanding):
    """Transmit again, before a commanded silence ends by itself.

    the same as `zacoustic silence resume`; quiet windows of the configuration stay

    Examples:
      zacoustic resume --connect tcp/127.0.0.1:7447        all gateways here
      zacoustic resume --node 2 --config router.json5      node 2, local or remote
    """

    async def work(self) -> None:
        """Send the command and print the new state."""
        from zacoustic.core.streams.commands import CommandKind

        await self.give(make_command(kind=CommandKind.RESUME))
