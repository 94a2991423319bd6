"""The verb `zacoustic silence`."""

import re
from typing import Final

from zacoustic.app.cli.remote.commanding import Commanding, make_command
from zacoustic.app.cli.support.rows import option, word
from zacoustic.errors import ConfigError

_UNITS_S: Final = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86400}
_DURATION: Final = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*([smhd]?)")


class Silence(Commanding):
    """Transmit nothing for a while: divers, other sonars.

    waiting data stays; a frame that the modem has begun is not cut off

    Examples:
      zacoustic silence --for 30m --connect tcp/127.0.0.1:7447    half an hour, all gateways here
      zacoustic silence --for 2h --node 2 --config router.json5   two hours, node 2, wherever it is
      zacoustic silence until-resumed --config router.json5       no end
      zacoustic silence resume --config router.json5              the end of it
      zacoustic silence --config router.json5                     what holds now

    A remote node is silent when the command has arrived, and its answer is its last frame. If none
    comes in time (exit code 3), it may be silent all the same.
    """

    command: str | None = word(
        None, "end the silence, or begin one without end", "?", choices=("resume", "until-resumed")
    )
    for_: str | None = option("TIME", "duration of the silence: 90s, 30m, 2h, 1d")

    async def work(self) -> None:
        """Send the command and print the new state.

        Raises:
            ConfigError: The arguments contradict each other.
        """
        from zacoustic.core.streams.commands import CommandKind

        for_s = None if self.for_ is None else _seconds(self.for_)
        if self.command is not None and for_s is not None:
            raise ConfigError(f"--for {self.for_}; allowed: not with {self.command}")
        kind = CommandKind.ASK if self.command is None and for_s is None else CommandKind.SILENCE
        if self.command == "resume":
            kind = CommandKind.RESUME
        await self.give(make_command(kind=kind, for_s=for_s))


def _seconds(written: str) -> float:
    """Read a duration such as ``30m``.

    Raises:
        ConfigError: It is not a duration.
    """
    found = _DURATION.fullmatch(written.strip())
    seconds = float(found[1]) * _UNITS_S[found[2]] if found else 0.0
    if seconds <= 0:
        raise ConfigError(f"--for {written}; allowed: a time above 0, such as 90s, 30m, 2h, 1d")
    return seconds
