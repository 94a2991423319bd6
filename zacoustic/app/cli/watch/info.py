"""The verb `zacoustic topic info`."""

from zacoustic.app.cli.support.rows import word
from zacoustic.app.cli.watch.watcher import Watcher
from zacoustic.errors import DeliveryError


class Info(Watcher):
    """One topic: its definition, and what gateways count of it.

    With --config it says what the file defines as well: type, publishers,
    subscribers, priority, reliability. A service or an action may be named, too. It costs no
    airtime.

    Examples:
      zacoustic topic info auv1/nav --connect tcp/127.0.0.1:7447
      zacoustic topic info auv1/nav --config router.json5
    """

    stream: str = word("TOPIC", "name or stream id")

    async def work(self) -> None:
        """Query the gateways and print.

        Raises:
            DeliveryError: No gateway is there, or none has the topic.
        """
        from zacoustic.app.tools.watch.streaminfo import definition_of, info_text, stream_in
        from zacoustic.app.tools.watch.views import told

        views = await self.views()
        found = [
            (view, stream)
            for view in views
            if (stream := stream_in(view.streams, self.stream)) is not None
        ]
        if not found:
            known = ", ".join(stream.name for view in views for stream in view.streams[:8])
            raise DeliveryError(
                f"no gateway here has a stream {self.stream}", hint=f"some that are: {known}"
            )
        config = self.fleet()
        definition = None if config is None else definition_of(config, found[0][1].id)
        counts = [{"gateway": view.address, "stream": told(stream)} for view, stream in found]
        self.show(
            {"definition": definition, "gateways": counts}, lambda _: info_text(found, definition)
        )
