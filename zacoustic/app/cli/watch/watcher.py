"""The common part of verbs that watch gateways."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.printing import print_json
from zacoustic.app.cli.support.rows import OBJECT_PER_LINE, flag, node_address
from zacoustic.app.cli.support.verb import NetworkVerb
from zacoustic.errors import DeliveryError

if TYPE_CHECKING:
    from zacoustic.app.tools.watch.views import GatewayView
    from zacoustic.app.tools.watch.watching import Watch


class Watcher(NetworkVerb):
    """A verb that watches the gateways of a network, or one of them."""

    node: int | None = node_address("address of one gateway (default: all that are here)")
    json: bool = flag(OBJECT_PER_LINE)

    def watch(self) -> "Watch":
        """Make the watch that the arguments describe; on the loop.

        Raises:
            ConfigError: The file is wrong.
        """
        from zacoustic.app.tools.watch.watching import Watch

        return Watch(self.fleet(), self.connect)

    async def views(self) -> "list[GatewayView]":
        """Query the gateways once, and return those that are wanted.

        Raises:
            ConfigError: The file is wrong.
            SessionError: No router can be reached.
            DeliveryError: No gateway is there.
        """
        async with self.watch() as watch:
            return self.chosen(watch)

    def chosen(self, watch: "Watch") -> "list[GatewayView]":
        """Return the wanted gateways.

        Raises:
            DeliveryError: There is none.
        """
        views = self.wanted(watch)
        if not views:
            which = "no gateway is" if self.node is None else f"gateway {self.node} is not"
            known = ", ".join(map(str, watch.board.addresses()))
            here = f"; there are: {known}" if known else ""
            hint = "is it running, and is --connect its router?"
            raise DeliveryError(f"{which} on this network{here}", hint=hint)
        return views

    def wanted(self, watch: "Watch") -> "list[GatewayView]":
        """Return the wanted gateways; perhaps none."""
        return [view for view in watch.board.views() if self.node in (None, view.address)]

    def print_rows(self, view: "GatewayView", rows: Iterable[object]) -> None:
        """Print rows of a gateway as JSON."""
        from zacoustic.app.tools.watch.views import told

        for row in rows:
            print_json({"gateway": view.address, **told(row)})
