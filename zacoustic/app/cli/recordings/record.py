"""The verb `zacoustic record`."""

import asyncio
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.rows import ONE_OBJECT, endpoint, flag, option, repeated, seconds
from zacoustic.app.cli.support.verb import FleetVerb
from zacoustic.link.command import EXIT_FAILED, EXIT_OK
from zacoustic.link.serving import stopped_by_signals

if TYPE_CHECKING:
    from zacoustic.app.tools.inspect.recordings.zenohrecord import RecordedKeys


class Record(FleetVerb):
    """Record topics, health and frames of running gateways, from any machine, as MCAP.

    records the topics of the config, the health documents @acoustic/** and the frames
    of every gateway on that network, until Ctrl-C. What a gateway does inside is in its
    own recording: zacoustic run gateway --record

    Example:
      zacoustic record -o trial.mcap --config fleet.json5 --connect tcp/192.168.0.2:7447
    """

    prints_late = False

    output: str = option("FILE", "the recording", flags=("-o", "--output"), required=True)
    config: str | None = option("FILE", "file with the topics and their types")
    connect: list[str] | None = endpoint()
    key: list[str] = repeated("EXPRESSION", "record this key expression as well")
    for_: float | None = seconds("end after this time, s")
    json: bool = flag(f"{ONE_OBJECT} at the end")

    async def work(self) -> int:
        """Record until Ctrl-C or the end of the time.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError: No router can be reached.
        """
        from zacoustic.app.tools.inspect.recordings.zenohrecord import record_network

        config = self.fleet()
        stop = asyncio.Event()
        with stopped_by_signals(stop), contextlib.ExitStack() as stack:
            if self.for_ is not None:
                timer = asyncio.get_running_loop().call_later(self.for_, stop.set)
                stack.callback(timer.cancel)
            found = await record_network(
                self.output,
                config=config,
                connect=self.connect,
                keys=self.key,
                stop=stop,
                ready=self._tell,
            )
        self.show(found, _as_text)
        return EXIT_FAILED if found.failure else EXIT_OK

    def _tell(self, path: Path, keys: Sequence[str]) -> None:
        self.note(f"{', '.join(keys)} into {path}")


def _as_text(found: "RecordedKeys") -> str:
    from zacoustic.app.tools.columns import align

    rows = [(key, str(number)) for key, number in found.messages.items()]
    lines = [align(("key", "samples"), rows, right=("samples",))]
    if found.gaps:
        times = f"{found.gaps} times: samples of those times are not recorded"
        lines.append(f"the Zenoh router was gone {times}")
    if found.dropped:
        lines.append(f"{found.dropped} messages were dropped: the disk was too slow, or is full")
    return "\n".join(lines)
