"""The verb `zacoustic nodes`."""

from zacoustic.app.cli.support.printing import print_text
from zacoustic.app.cli.watch.watcher import Watcher


class Nodes(Watcher):
    """The other nodes: when heard, signal, range, loss, by which link.

    Heard is the time since the last frame of a node; range is the last measured
    one (zacoustic ping measures anew); loss is the share of frames without an acknowledgement of
    its modem. It costs no airtime.

    Examples:
      zacoustic nodes --connect tcp/127.0.0.1:7447
      zacoustic nodes --config router.json5 --json
    """

    async def work(self) -> None:
        """Query the gateways and print."""
        from zacoustic.app.tools.watch.statustext import nodes_text

        for view in await self.views():
            if self.json:
                self.print_rows(view, view.peers)
            else:
                print_text(nodes_text(view))
