"""One node's place on the channel, and the modem attached to it; `medium` drives it."""

from collections.abc import Callable
from typing import TypeAlias

from zacoustic.channel.modems import Station
from zacoustic.channel.profiles import ModemProfile
from zacoustic.core.linktypes import TransmitOutcome
from zacoustic_sim.messages import Carrier, Finished, ServerMessage, Transmit

Tell: TypeAlias = Callable[[ServerMessage], None]
"""Takes the medium's messages to one modem."""


class Place(Station[Transmit]):
    """One place on the channel.

    Args:
        address: Address of the node.
        profile: Profile of its modem.
    """

    __slots__ = ("_is_carrier_told", "tell")

    def __init__(self, address: int, profile: ModemProfile) -> None:
        super().__init__(address, profile)
        self.tell: Tell | None = None
        self.unplug()

    def plug(self, tell: Tell) -> None:
        """Attach a modem."""
        self.tell, self.is_up = tell, True

    def unplug(self) -> None:
        """Detach the modem."""
        self.tell, self.is_up = None, False
        self.pending = []
        self._is_carrier_told = False

    def say(self, message: ServerMessage) -> None:
        """Send a message to the modem, if one is attached."""
        if self.tell is not None:
            self.tell(message)

    def reject(self, request: Transmit, reason: str) -> None:
        """Report that a frame will not be transmitted."""
        outcome = TransmitOutcome.REJECTED
        self.say(Finished(request.transmission_id, outcome, detail=reason))

    def tell_carrier(self) -> None:
        """Report whether others are audible, unless the modem knows it."""
        if self.tell is not None and self._is_carrier_told != bool(self.carriers):
            self._is_carrier_told = bool(self.carriers)
            self.say(Carrier(self._is_carrier_told))
