"""The verb `zacoustic topic bw`."""

import asyncio
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.rows import seconds, word
from zacoustic.app.cli.watch.watcher import Watcher
from zacoustic.errors import DeliveryError
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT

if TYPE_CHECKING:
    from zacoustic.app.tools.watch.watching import Watch


class Bw(Watcher):
    """How many bytes of the channel a topic takes: per second, per sample.

    Bytes are those that gateways here transmit for it, with headers,
    acknowledgements and repeats; a gateway that only receives it transmits
    only its acknowledgements. It costs no airtime.

    Examples:
      zacoustic topic bw auv1/nav --connect tcp/127.0.0.1:7447
      zacoustic topic bw auv1/nav --config router.json5 --node 2 --timeout 60 --json
    """

    stream: str = word("TOPIC", "name or stream id")
    interval: float = seconds("time between two lines, s", 10.0)
    timeout: float | None = seconds(
        "end after this time, s; exit code 3 when nothing was transmitted"
    )
    runs_on = True

    async def work(self) -> int:
        """Print until the time is over, or Ctrl-C.

        Raises:
            DeliveryError: No gateway is there, or none has the topic.
        """
        loop = asyncio.get_running_loop()
        async with self.watch() as watch:
            first = last = self._counts(watch)
            began = then = loop.time()
            end = float("inf") if self.timeout is None else began + self.timeout
            while loop.time() < end:
                await asyncio.sleep(min(self.interval, end - loop.time()))
                await watch.ask()
                counts, now = self._counts(watch), loop.time()
                self._print(_less(counts, last), now - then)
                last, then = counts, now
        if last == first:
            self.note(f"nothing transmitted within {self.timeout:g} s")
            return EXIT_TIMED_OUT
        return EXIT_OK

    def _counts(self, watch: "Watch") -> tuple[int, int]:
        """Return the bytes and records that the gateways have transmitted so far.

        Raises:
            DeliveryError: No gateway is there, or none has the topic.
        """
        from zacoustic.app.tools.watch.streaminfo import stream_in

        found = [stream_in(view.streams, self.stream) for view in self.chosen(watch)]
        streams = [stream for stream in found if stream is not None]
        if not streams:
            raise DeliveryError(
                f"no gateway here has a stream {self.stream}", hint="see zacoustic topic list"
            )
        return sum(each.airtime_bytes for each in streams), sum(each.sent for each in streams)

    def _print(self, added: tuple[int, int], seconds: float) -> None:
        size_bytes, records = added
        rate = size_bytes / seconds
        each = size_bytes / records if records else None
        record = {
            "stream": self.stream,
            "bytes": size_bytes,
            "samples": records,
            "bytes_per_s": round(rate, 3),
            "bytes_per_sample": None if each is None else round(each, 3),
            "over_s": round(seconds, 3),
        }
        of_each = "" if each is None else f", {each:.1f} B each"
        self.line(record, f"{rate:.2f} B/s: {records} records{of_each}, within {seconds:.0f} s")


def _less(counts: tuple[int, int], before: tuple[int, int]) -> tuple[int, int]:
    """Return what was added; a restarted gateway counts from 0."""
    return max(0, counts[0] - before[0]), max(0, counts[1] - before[1])
