"""One link of a runner: what is known of it, and where what it says goes.

A link that was lost comes back by itself. One that cannot be opened does not, so `LinkSide` opens
it again, after the pauses of a byte stream, and says meanwhile that it is down. So is one that is
open and cannot do what the config asks of it, such as one whose frames are too short: the others go
on, and it is tried again whenever it comes up.
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
    """Takes what links say."""

    def take_frame(self, side: "LinkSide", frame: ReceivedFrame) -> None:
        """A frame arrived."""

    def take_report(self, side: "LinkSide", report: TransmitReport) -> None:
        """A transmission has ended."""

    def take_state(self, side: "LinkSide", state: LinkState, detail: str) -> None:
        """The link went up or down."""

    def take_carrier(self, side: "LinkSide", busy: bool) -> None:
        """Another node is audible, or not any more."""

    def take_measurement(self, side: "LinkSide", measurement: Measurement) -> None:
        """The link has measured something."""

    def fail(self, error: Exception) -> None:
        """The link has a fault."""


class LinkSide:
    """One link of a runner, as the receiver of that link.

    Args:
        link: The link, not open yet.
        name: Its name for the engine; None: it is the first one.
        runner: Takes what it says.
    """

    def __init__(self, link: Link, name: str | None, runner: SideRunner) -> None:
        self.link = link
        self.name = name
        """Its name for the engine; None: it is the first one."""
        self.by: tuple[str, ...] = () if name is None else (name,)
        """What inputs of the engine end with."""
        self.state = LinkState.OPENING
        """What it last said of itself."""
        self.detail = ""
        """What it said it waits for."""
        self.is_busy = False
        """Another node is audible."""
        self.on_air: Transmission | None = None
        """What it transmits now."""
        self.is_foreign_on_air = False
        """That is of a former engine."""
        self.open_failure = ""
        """Why it could not be opened; it is tried again."""
        self._runner = runner
        self._awaits: str | None = None
        """What a repeated attempt waits for; told when it has succeeded."""
        self._opening: asyncio.Task[None] | None = None

    def keep_opening(self) -> None:
        """Open the link, again and again until it is open; returns at once."""
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
        except Exception as error:  # a fault of the link
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
        """A transmission has ended."""
        self._runner.take_report(self, report)

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """The link went up or down; an attempt after one that failed is no news before its end."""
        is_attempt = state is LinkState.OPENING and bool(self.open_failure)
        self._awaits = detail if is_attempt else None
        if not is_attempt:
            self._runner.take_state(self, state, detail)

    def carrier_changed(self, busy: bool) -> None:
        """Another node is audible, or not any more."""
        self._runner.take_carrier(self, busy)

    def measured(self, measurement: Measurement) -> None:
        """The link has measured something."""
        self._runner.take_measurement(self, measurement)
