"""The verbs `zacoustic topic list`, `service list` and `action list`."""

from typing import ClassVar

from zacoustic.app.cli.support.printing import print_text
from zacoustic.app.cli.support.rows import flag
from zacoustic.app.cli.watch.watcher import Watcher


class Streams(Watcher):
    """Streams of one kind, once."""

    kind: ClassVar[str]
    wide: bool = False

    async def work(self) -> None:
        """Query the gateways and print."""
        from zacoustic.app.tools.watch.topicstext import streams_text, topics_text

        for view in await self.views():
            if self.json:
                streams = view.streams
                self.print_rows(
                    view, [each for each in streams if self.wide or each.kind == self.kind]
                )
            else:
                print_text(topics_text(view) if self.wide else streams_text(view, self.kind))


class Topics(Streams):
    """The topics that cross the channel: how often, how old, what waits.

    A line for each way that a topic takes through a gateway. Count is that of records on
    the channel, last the time since the last of them, acknowledgements included, rate their present
    rate; age is that of the newest sample received here (topics with stamp: "age"). It costs no
    airtime.

    Examples:
      zacoustic topic list --connect tcp/127.0.0.1:7447
      zacoustic topic list --config router.json5 --node 2 --json
    """

    kind = "topic"
    wide: bool = flag("services and actions as well, in one line each, wider than a terminal")


class Services(Streams):
    """The services that cross the channel: how often, what waits.

    It costs no airtime.

    Example:
      zacoustic service list --connect tcp/127.0.0.1:7447
    """

    kind = "service"


class Actions(Streams):
    """The actions that cross the channel: how often, what waits.

    It costs no airtime.

    Example:
      zacoustic action list --connect tcp/127.0.0.1:7447
    """

    kind = "action"
