"""One link of a runner: what is known of it, and where what it says goes."""

from typing import Protocol

from zacoustic.core.base.linktypes import (
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
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
        self._runner = runner

    def frame_received(self, frame: ReceivedFrame) -> None:
        """A frame arrived."""
        self._runner.take_frame(self, frame)

    def transmit_finished(self, report: TransmitReport) -> None:
        """A transmission has ended."""
        self._runner.take_report(self, report)

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """The link went up or down."""
        self._runner.take_state(self, state, detail)

    def carrier_changed(self, busy: bool) -> None:
        """Another node is audible, or not any more."""
        self._runner.take_carrier(self, busy)

    def measured(self, measurement: Measurement) -> None:
        """The link has measured something."""
        self._runner.take_measurement(self, measurement)
