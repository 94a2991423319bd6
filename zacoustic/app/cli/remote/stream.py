"""The verb `zacoustic stream`."""

import argparse
from typing import Any

from zacoustic.app.cli.remote.commanding import NODE, Commanding, make_command
from zacoustic.app.cli.support.rows import flag, node_address, option, real, whole, word
from zacoustic.errors import ConfigError


class Stream(Commanding):
    """Switch a topic of a node off or on, set its rate and priority.

    for a topic that the node publishes; it applies at once, without a restart,
    and survives one if the node has a journal

    Examples:
      zacoustic stream auv1/nav --node 2 --config shore.json5                   how it is sent
      zacoustic stream auv1/nav --node 2 --off --config shore.json5             not at all
      zacoustic stream auv1/nav --node 2 --on --rate 0.1 --config shore.json5   at most every 10 s
      zacoustic stream auv1/nav --node 2 --priority background --config shore.json5
      zacoustic stream auv1/nav --node 2 --reset --config shore.json5           as its file says
    """

    stream: str | None = word(
        "STREAM", "name or stream id; a name is that of --config, or of a gateway here", "?"
    )
    id: int | None = whole("ID", argparse.SUPPRESS)
    on: bool = flag("its samples go", either="switch")
    off: bool = flag("they wait, expire and are superseded", either="switch")
    reset: bool = flag("everything as the node's file configures it", either="switch")
    rate: float | None = real("HZ", "maximum rate of samples of a key")
    priority: str | None = option("NAME", "Zenoh's, such as background")
    node: int = node_address(NODE, required=True)

    async def work(self) -> None:
        """Send the command and print the new state.

        Raises:
            ConfigError: An argument is wrong.
        """
        from zacoustic.core.base.qos import PRIORITY_NAMES
        from zacoustic.core.streams.commands import CommandKind

        fields: dict[str, Any] = {
            "on": True if self.on else False if self.off else None,
            "min_interval_s": None if self.rate is None else 1 / self.rate,
        }
        if self.priority is not None:
            if self.priority not in PRIORITY_NAMES:
                allowed = ", ".join(PRIORITY_NAMES)
                raise ConfigError(f"--priority {self.priority}; allowed: {allowed}")
            fields["priority"] = PRIORITY_NAMES[self.priority]
        is_overridden = any(value is not None for value in fields.values())
        if self.reset and is_overridden:
            raise ConfigError("--reset; allowed: not with --rate and --priority")
        kind = CommandKind.OVERRIDE if is_overridden else CommandKind.ASK
        if self.reset:
            kind = CommandKind.RESET
        await self.give(make_command(kind=kind, stream_id=await self._stream_id(), **fields))

    async def _stream_id(self) -> int:
        """Return the id of the stream that the arguments name.

        Raises:
            ConfigError: None is named, or two are, or there is none of this name.
        """
        if (self.stream is None) == (self.id is None):
            raise ConfigError("STREAM; allowed: one, by its name or id")
        if self.stream is None or (self.stream.isascii() and self.stream.isdigit()):
            return int(self.stream or self.id or 0)
        config = self.fleet()
        if config is None:
            known = await self._ids_of_gateways()
        else:
            known = {stream.name: stream.stream_id for stream in config.table}
        if self.stream not in known:
            names = ", ".join(sorted(known)[:8])
            raise ConfigError(f"STREAM {self.stream}; allowed: {names or 'a stream id'}")
        return known[self.stream]

    async def _ids_of_gateways(self) -> dict[str, int]:
        """Return the ids of the streams of all gateways here, by name."""
        from zacoustic.app.tools.watch.watching import Watch

        async with Watch(None, self.connect) as watch:
            views = watch.board.views()
        return {stream.name: stream.id for view in views for stream in view.streams}
