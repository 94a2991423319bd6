"""The verb `zacoustic topic hz`."""

import asyncio
import contextlib
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.participant import Participant
from zacoustic.app.cli.support.rows import seconds, whole, word
from zacoustic.app.cli.use.sub import subscribe
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT

if TYPE_CHECKING:
    from zacoustic.app.tools.field.rates import RateMeter


class Hz(Participant):
    """How often samples of a topic arrive: mean, shortest and longest time between.

    It counts the samples that arrive on this network or link: behind a gateway,
    those that have crossed; zacoustic topic list shows the rates of records on the channel.

    Examples:
      zacoustic topic hz auv1/nav --connect tcp/127.0.0.1:7447
      zacoustic topic hz auv1/nav --config router.json5 --window 20 --timeout 600 --json
    """

    key: str = word("KEY", "topic of the config, or key expression")
    window: int = whole("N", "how many of the last samples count", 100, least=2, most=1_000_000)
    interval: float = seconds("time between two lines, s", 5.0)
    timeout: float | None = seconds(
        "end after this time, s; exit code 3 with less than two samples"
    )
    runs_on = True

    async def work(self) -> int:
        """Print until the time is over, or Ctrl-C."""
        from zacoustic.app.tools.field.rates import RateMeter

        meter = RateMeter(self.window)
        loop = asyncio.get_running_loop()
        async with self.make_node() as node:
            subscribe(node, [self.key], lambda sample: meter.note(loop.time()))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self.timeout):
                    while True:
                        await asyncio.sleep(self.interval)
                        self._print(meter)
        self._print(meter)
        if meter.rate() is not None:
            return EXIT_OK
        self.note(f"{meter.total} samples within {self.timeout:g} s")
        return EXIT_TIMED_OUT

    def _print(self, meter: "RateMeter") -> None:
        import msgspec

        rate = meter.rate()
        if rate is None:
            return
        text = (
            f"{rate.rate_hz:.3g}/s: {rate.min_s:.2f}..{rate.max_s:.2f} s between two, "
            f"deviation {rate.deviation_s:.2f} s, {rate.samples} samples"
        )
        self.line({"key": self.key, **msgspec.to_builtins(rate), "total": meter.total}, text)
