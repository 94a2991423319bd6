"""The verb `zacoustic status`."""

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.watch.watcher import Watcher
from zacoustic.link.command import EXIT_FAILED, EXIT_OK


class Status(Watcher):
    """Is the link up, who was heard, which streams fail: ten lines a gateway.

    exit code 1: a gateway is gone, its link is not up, it may not transmit, its
    journal fails, or a stream is stopped. It costs no airtime.

    Examples:
      zacoustic status --connect tcp/127.0.0.1:7447
      zacoustic status --config router.json5 --json
    """

    async def work(self) -> int:
        """Query the gateways and print; exit code 1 if something is wrong with one."""
        from zacoustic.app.tools.watch.statustext import goes_well, status_of, status_text

        views = await self.views()
        for view in views:
            if self.json:
                print_json(status_of(view))
            else:
                print_text(status_text(view))
        return EXIT_OK if all(goes_well(view) for view in views) else EXIT_FAILED
