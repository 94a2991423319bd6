"""One place on the channel, and the modem that has it; `medium` moves it."""

from collections.abc import Callable
from typing import TypeAlias

from zacoustic.channel.modems import Station
from zacoustic.channel.profiles import ModemProfile
from zacoustic.core.linktypes import TransmitOutcome
from zacoustic_sim.messages import Carrier, Finished, ServerMessage, Transmit

Tell: TypeAlias = Callable[[ServerMessage], None]
"""How the medium talks to one modem."""


class Place(Station[Transmit]):
    """One place on the channel.

    Args:
        address: Of its node.
        profile: Of its modem.
    """

    __slots__ = ("_is_carrier_told", "tell")

    def __init__(self, address: int, profile: ModemProfile) -> None:
        super().__init__(address, profile)
        self.tell: Tell | None = None
        self.unplug()

    def plug(self, tell: Tell) -> None:
        """Let a modem have it."""
        self.tell, self.is_up = tell, True

    def unplug(self) -> None:
        """Let its modem go."""
        self.tell, self.is_up = None, False
        self.pending = []
        self._is_carrier_told = False

    def say(self, message: ServerMessage) -> None:
        """Tell the modem, if there is one."""
        if self.tell is not None:
            self.tell(message)

    def reject(self, request: Transmit, reason: str) -> None:
        """Tell it that a frame will not be sent."""
        outcome = TransmitOutcome.REJECTED
        self.say(Finished(request.transmission_id, outcome, detail=reason))

    def tell_carrier(self) -> None:
        """Tell it whether it hears others, unless it knows that."""
        if self.tell is not None and self._is_carrier_told != bool(self.carriers):
            self._is_carrier_told = bool(self.carriers)
            self.say(Carrier(self._is_carrier_told))
