"""One link of a runner: its state, and the way of its reports to the runner.

A link that was lost reconnects by itself. One that cannot be opened does not, so `LinkSide` opens
it again, with the back-off of a byte stream, and reports it as down meanwhile. It also reports a
link as down that is open but cannot do what the config asks, for example because its frames are too
short. The other links go on, and such a link is tried again whenever it comes up.
"""

import asyncio
from typing import Protocol

from zacoustic.core.base.linktypes import (
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link.bytestream.stream import FIRST_DELAY_S, LAST_DELAY_S
from zacoustic.link.contract import Link


class SideRunner(Protocol):
    """Takes the reports of links."""

    def take_frame(self, side: "LinkSide", frame: ReceivedFrame) -> None:
        """A frame arrived."""

    def take_report(self, side: "LinkSide", report: TransmitReport) -> None:
        """A transmission ended."""

    def take_state(self, side: "LinkSide", state: LinkState, detail: str) -> None:
        """The link went up or down."""

    def take_carrier(self, side: "LinkSide", busy: bool) -> None:
        """Another node became audible or inaudible."""

    def take_measurement(self, side: "LinkSide", measurement: Measurement) -> None:
        """The device measured something."""

    def fail(self, error: Exception) -> None:
        """The link raised an unexpected error."""


class LinkSide:
    """One link of a runner; the receiver of that link.

    Args:
        link: The link, not open yet.
        name: Its name for the engine; None: it is the first link.
        runner: Takes its reports.
    """

    def __init__(self, link: Link, name: str | None, runner: SideRunner) -> None:
        self.link = link
        self.name = name
        """Its name for the engine; None: it is the first link."""
        self.by: tuple[str, ...] = () if name is None else (name,)
        """Last arguments of the engine's inputs."""
        self.state = LinkState.OPENING
        """Its last reported state."""
        self.detail = ""
        """What it waits for, by its last report."""
        self.is_busy = False
        """Another node is audible."""
        self.on_air: dict[int, Transmission] = {}
        """Its present transmissions, by id; more than one only on a bulk service."""
        self.foreign: set[int] = set()
        """Those of them that are of a former engine."""
        self.open_failure = ""
        """Why it could not be opened; the attempt is repeated."""
        self._runner = runner
        self._awaits: str | None = None
        """What a repeated attempt waits for; logged after it has succeeded."""
        self._opening: asyncio.Task[None] | None = None

    def keep_opening(self) -> None:
        """Open the link, repeating until it succeeds; returns at once."""
        name = f"opens {self.name}"
        self._opening = asyncio.get_running_loop().create_task(self._open(), name=name)

    async def close(self) -> None:
        """Close the link."""
        task, self._opening = self._opening, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])
        await self.link.close()

    async def _open(self) -> None:
        delay_s = FIRST_DELAY_S
        try:
            while not await self._is_opened():
                await asyncio.sleep(delay_s)
                delay_s = min(2 * delay_s, LAST_DELAY_S)
        except Exception as error:  # a bug of the link
            self._runner.fail(error)

    async def _is_opened(self) -> bool:
        try:
            await self.link.open(self)
        except (LinkOpenError, ConfigError) as error:
            await self.link.close()
            told, self.open_failure = self.open_failure, str(error)
            if told != self.open_failure:
                self._runner.take_state(self, LinkState.DOWN, self.open_failure)
            return False
        self.open_failure = ""
        if self._awaits is not None:
            self._runner.take_state(self, LinkState.OPENING, self._awaits)
        return True

    def frame_received(self, frame: ReceivedFrame) -> None:
        """A frame arrived."""
        self._runner.take_frame(self, frame)

    def transmit_finished(self, report: TransmitReport) -> None:
        """A transmission ended."""
        self._runner.take_report(self, report)

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """The link went up or down; the start of a repeated attempt is not reported."""
        is_attempt = state is LinkState.OPENING and bool(self.open_failure)
        self._awaits = detail if is_attempt else None
        if not is_attempt:
            self._runner.take_state(self, state, detail)

    def carrier_changed(self, busy: bool) -> None:
        """Another node became audible or inaudible."""
        self._runner.take_carrier(self, busy)

    def measured(self, measurement: Measurement) -> None:
        """The device measured something."""
        self._runner.take_measurement(self, measurement)
