"""Settings of a link over Iridium, from its locator."""

import sys
from typing import Annotated, Final

from msgspec import Meta

from zacoustic.core.clock import Duration, DurationOrZero
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.errors import ConfigError
from zacoustic.link import LinkConfig

MOST_SENT_BYTES: Final = 340
"""Largest message from a modem (9602, 9603, RockBLOCK)."""
MOST_RECEIVED_BYTES: Final = 270
"""Largest message to a modem."""
_BIT_RATE_BPS: Final = 100_000.0
"""So that the bytes themselves take next to nothing."""


class IridiumConfig(LinkConfig, frozen=True, kw_only=True):
    """Settings of the link."""

    max_bytes_per_day: Annotated[int, Meta(ge=0)] = 0
    """How many bytes may be paid for in 24 h, in quanta; 0: nothing is transmitted."""
    quantum_bytes: Annotated[int, Meta(ge=1)] = 50
    """A message costs a multiple of this, bytes."""
    price: Annotated[float, Meta(ge=0, le=sys.float_info.max)] = 0.0
    """Price of a quantum, for the counters."""
    mtu: Annotated[int, Meta(ge=32, le=MOST_SENT_BYTES)] = MOST_RECEIVED_BYTES
    """Largest frame, bytes; above 270 only where no modem receives it."""
    give_up_s: Duration = 300.0
    """How long to try to transmit a frame, s: then the engine may choose a newer one."""
    check_s: DurationOrZero = 0.0
    """Look for messages so often, s; each look costs a quantum. 0: only when the modem
    rings."""
    session_s: Duration = 20.0
    """Usual duration of a session with the satellite, s."""
    baudrate: int = 19_200
    """Of the serial port, baud."""
    gateway: str = ""
    """On shore: HOST:PORT of the provider's DirectIP gateway, for messages to the modem."""
    imei: str = ""
    """On shore: the modem's number, 15 digits."""

    def capabilities(self) -> LinkCapabilities:
        """Return what the link can do: all the time is in sessions, at both ends."""
        return LinkCapabilities(
            mtu_bytes=self.mtu,
            bit_rate_bps=_BIT_RATE_BPS,
            propagation_s=2 * self.session_s,
            half_duplex=False,
            addressed=False,
            controls_access=True,
        )

    def require_budget(self) -> None:
        """Check that a budget is given.

        Raises:
            ConfigError: It is not.
        """
        if not self.max_bytes_per_day:
            raise ConfigError(
                "max_bytes_per_day is missing; allowed: a number of bytes that may be paid for",
                hint="each message costs money: say how much, such as #max_bytes_per_day=5000",
            )
