"""Events of the dialogue for its shell, in order."""

from collections import deque
from collections.abc import Iterable

from zacoustic.core.linktypes import (
    LinkState,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic_evologics.driver.events import Event, LinkChanged, Measured, TransmissionEnded
from zacoustic_evologics.driver.session.measuring import modem_read
from zacoustic_evologics.driver.session.session import ModemSession


class Outbox:
    """Stores events until they are polled, and counts outcomes of transmissions.

    Args:
        session: Takes the counts.
    """

    def __init__(self, session: ModemSession) -> None:
        self.detail = ""
        """The modem, or what the link waits for."""
        self.has_been_up = False
        """Since the link was opened. Before that, a link without a modem is OPENING, not DOWN."""
        self._session = session
        self._events: deque[Event] = deque()

    def poll(self) -> Event | None:
        """Return the next event."""
        return self._events.popleft() if self._events else None

    def put(self, events: Iterable[Event]) -> None:
        """Add events."""
        self._events.extend(events)

    def up(self, now: int) -> None:
        """Report that the modem is ready."""
        self.has_been_up = True
        self.detail = self._session.description()
        self.put([LinkChanged(LinkState.UP, self.detail, self._session.capabilities())])
        self.put([Measured(modem_read(self._session, now))])

    def down(self, detail: str) -> None:
        """Report that there is no modem, and why."""
        self.detail = detail
        state = LinkState.DOWN if self.has_been_up else LinkState.OPENING
        self.put([LinkChanged(state, detail)])

    def report(self, report: TransmitReport) -> None:
        """Report the end of a transmission."""
        self._session.count_outcome(report.outcome)
        self.put([TransmissionEnded(report)])

    def refuse(
        self, transmission: Transmission, outcome: TransmitOutcome, reason: str, now: int
    ) -> None:
        """Report that a transmission was not begun."""
        self.report(
            TransmitReport(
                transmission_id=transmission.transmission_id,
                outcome=outcome,
                started_at=now,
                finished_at=now,
                detail=reason,
            )
        )
