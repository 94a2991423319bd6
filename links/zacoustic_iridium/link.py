"""Iridium as a link: what a modem at sea and the shore have in common."""

import time
from abc import abstractmethod
from typing import Self

from zacoustic.core.clock import Clock
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.errors import ConfigError, LinkClosedError, LinkOpenError
from zacoustic.link import Link, LinkConfig, LinkReceiver
from zacoustic_iridium.budget import Budget
from zacoustic_iridium.config import IridiumConfig

_ALLOWED = "serial:PORT, tcp:HOST:PORT, or on shore directip:HOST:PORT"


class IridiumLink(Link):
    """Short Burst Data; the locator is iridium/serial:PORT, or on shore iridium/directip:HOST:PORT.

    A node transmits nothing without a budget, and nothing while it is spent.

    Args:
        name: The locator.
        config: Its settings.
        clock: Source of instants.

    Raises:
        ConfigError: There is no budget.
    """

    config_type = IridiumConfig

    def __init__(
        self, name: str, config: IridiumConfig, *, clock: Clock = time.monotonic_ns
    ) -> None:
        config.require_budget()
        self._name = name
        self._config = config
        self._clock = clock
        self.capabilities = config.capabilities()
        self._budget = Budget(config.max_bytes_per_day, config.quantum_bytes)
        self._receiver: LinkReceiver | None = None
        self._state = LinkState.OPENING
        self._detail = ""
        self._on_air: tuple[Transmission, int] | None = None
        self._refusals: list[TransmitReport] = []
        self._last_at = 0
        self._counts = dict.fromkeys(("sent", "received", "failed"), 0)

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Build the link of a modem, or of the shore.

        Raises:
            ConfigError: The address is neither, or there is no budget.
        """
        from zacoustic_iridium.atsea import ModemLink
        from zacoustic_iridium.onshore import ShoreLink

        assert isinstance(config, IridiumConfig)
        kind, colon, rest = address.partition(":")
        kinds: dict[str, type[IridiumLink]] = {
            "serial": ModemLink, "tcp": ModemLink, "directip": ShoreLink,
        }  # fmt: skip
        if kind not in kinds or not colon or not rest:
            raise ConfigError(f"iridium/{address}; allowed: {_ALLOWED}")
        made = kinds[kind](address, config)
        assert isinstance(made, cls)
        return made

    async def open(self, receiver: LinkReceiver) -> None:
        """Begin to connect; raises LinkOpenError if it is open already."""
        if self._receiver is not None:
            raise LinkOpenError(f"iridium/{self._name} is open already")
        self._receiver = receiver
        self._state, self._detail = LinkState.OPENING, ""
        receiver.state_changed(LinkState.OPENING, f"opens {self._name}")

    async def close(self) -> None:
        """Release everything; report an outstanding frame as ABORTED."""
        receiver = self._receiver
        if receiver is not None:
            self._finish(TransmitOutcome.ABORTED, "the link was closed")
            self._flush()
        self._receiver = None
        self._state, self._detail = LinkState.DOWN, "closed"

    def transmit(self, transmission: Transmission) -> None:
        """Begin to send a frame; a report follows.

        Raises:
            LinkClosedError: Not open.
        """
        if self._receiver is None:
            raise LinkClosedError(f"iridium/{self._name} is not open")
        now = self._clock()
        if self._state is not LinkState.UP:
            self._refuse(transmission, TransmitOutcome.ABORTED, self._detail or "not up", now)
        elif reason := self._objection(transmission, now):
            self._refuse(transmission, TransmitOutcome.REJECTED, reason, now)
        else:
            self._on_air = transmission, now
            self._begin(transmission.frame_bytes, now)
        self._soon()

    def diagnostics(self) -> dict[str, int | float | str]:
        """Return counters, and what was spent."""
        spent = self._budget.spent_bytes
        return {
            **self._counts,
            "spent_bytes": spent,
            "spent_money": round(spent / self._config.quantum_bytes * self._config.price, 2),
            "state": self._state.value,
            "detail": self._detail,
        }

    # For the two kinds

    @abstractmethod
    def _begin(self, frame_bytes: bytes, now: int) -> None:
        """Begin to send a frame."""

    @abstractmethod
    def _soon(self) -> None:
        """Call `_flush` from the loop, and do what is due."""

    def _change_state(self, state: LinkState, detail: str = "") -> None:
        if (state, detail) == (self._state, self._detail):
            return
        self._state, self._detail = state, detail
        if self._receiver is not None:
            self._receiver.state_changed(state, detail)

    def _finish(self, outcome: TransmitOutcome, detail: str = "") -> None:
        """Report the frame on the air, if there is one: it was so at the end of its session."""
        if self._on_air is None or self._receiver is None:
            return
        (transmission, given_at), self._on_air = self._on_air, None
        self._counts["sent" if outcome is TransmitOutcome.SENT else "failed"] += 1
        airtime_ns = self.capabilities.airtime_ns(len(transmission.frame_bytes))
        started_at = max(given_at, self._clock() - airtime_ns)
        self._report(transmission, outcome, detail, started_at)

    def _hear(self, frame_bytes: bytes, at: int) -> None:
        if self._receiver is not None:
            self._counts["received"] += 1
            self._last_at = max(at, self._last_at)
            self._receiver.frame_received(
                ReceivedFrame(frame_bytes=frame_bytes, received_at=self._last_at)
            )

    def _flush(self) -> None:
        """Hand over the reports of refused frames."""
        refusals, self._refusals = self._refusals, []
        for report in refusals:
            if self._receiver is not None:
                self._receiver.transmit_finished(report)

    def _objection(self, transmission: Transmission, now: int) -> str:
        size, limit = len(transmission.frame_bytes), self.capabilities.mtu_bytes
        if self._on_air is not None:
            return "another frame is being sent"
        if not 1 <= size <= limit:
            return f"frame of {size} bytes; allowed: 1..{limit}"
        if not 1 <= transmission.destination <= BROADCAST:
            return f"destination {transmission.destination}; allowed: 1..{BROADCAST}"
        if not self._budget.allows(size, now):
            return f"the budget of {self._config.max_bytes_per_day} bytes a day is spent"
        return ""

    def _refuse(
        self, transmission: Transmission, outcome: TransmitOutcome, detail: str, now: int
    ) -> None:
        self._refusals.append(
            TransmitReport(
                transmission_id=transmission.transmission_id,
                outcome=outcome,
                started_at=now,
                finished_at=now,
                detail=detail,
            )
        )

    def _report(
        self, transmission: Transmission, outcome: TransmitOutcome, detail: str, started_at: int
    ) -> None:
        assert self._receiver is not None
        self._receiver.transmit_finished(
            TransmitReport(
                transmission_id=transmission.transmission_id,
                outcome=outcome,
                started_at=started_at,
                finished_at=max(started_at, self._clock()),
                detail=detail,
            )
        )
