"""One place on the channel, and what its modem is busy with; `medium` moves it."""

from collections.abc import Callable
from typing import TypeAlias

from zacoustic.channel.profiles import ModemProfile
from zacoustic.core.linktypes import TransmitOutcome
from zacoustic_sim.messages import Carrier, Finished, ServerMessage, Transmit

Tell: TypeAlias = Callable[[ServerMessage], None]
"""How the medium talks to one modem."""


class Place:
    """One place on the channel.

    Args:
        address: Of its node.
        profile: Of its modem.
    """

    def __init__(self, address: int, profile: ModemProfile) -> None:
        self.address = address
        self.profile = profile
        self.tell: Tell | None = None
        # Its modem has a frame that is not out of it yet.
        self.is_busy = False
        # End of the gap behind the last frame, ns.
        self.ready_at = 0
        # End of the last sound of its own, ns.
        self.silent_at = 0
        # The frame whose acknowledgement it waits for, and when that began, ns.
        self.waits_for: tuple[Transmit, int] | None = None
        # How many transmissions of others it hears at this moment.
        self.audible = 0

    def say(self, message: ServerMessage) -> None:
        """Tell the modem, if there is one."""
        if self.tell is not None:
            self.tell(message)

    def reject(self, request: Transmit, reason: str) -> None:
        """Tell it that a frame will not be sent."""
        outcome = TransmitOutcome.REJECTED
        self.say(Finished(request.transmission_id, outcome, detail=reason))

    def hear_begin(self) -> None:
        """Somebody becomes audible."""
        self.audible += 1
        if self.audible == 1:
            self.say(Carrier(True))

    def hear_end(self) -> None:
        """Somebody falls silent."""
        self.audible -= 1
        if self.audible == 0:
            self.say(Carrier(False))
