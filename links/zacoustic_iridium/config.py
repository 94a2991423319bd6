"""Settings of a link over Iridium, from its locator."""

import math
from typing import Final

from zacoustic.core.clock import DURATIONS, is_duration
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.errors import ConfigError
from zacoustic.link import LinkConfig

MOST_SENT_BYTES: Final = 340
"""Largest message from a modem (9602, 9603, RockBLOCK)."""
MOST_RECEIVED_BYTES: Final = 270
"""Largest message to a modem."""
_LEAST_MTU_BYTES: Final = 32
_BIT_RATE_BPS: Final = 100_000.0
"""So that the bytes themselves take next to nothing."""


class IridiumConfig(LinkConfig, frozen=True, kw_only=True):
    """Settings of the link."""

    max_bytes_per_day: int = 0
    """How many bytes may be paid for in 24 h, in quanta; 0: nothing is transmitted."""
    quantum_bytes: int = 50
    """A message costs a multiple of this, bytes, ≥ 1."""
    price: float = 0.0
    """Price of a quantum, for the counters, ≥ 0."""
    mtu: int = MOST_RECEIVED_BYTES
    """Largest frame, bytes, 32…340; above 270 only where no modem receives it."""
    give_up_s: float = 300.0
    """How long to try to transmit a frame, s, > 0: then the engine may choose a newer one."""
    check_s: float = 0.0
    """Look for messages so often, s, ≥ 0; each look costs a quantum. 0: only when the modem
    rings."""
    session_s: float = 20.0
    """Usual duration of a session with the satellite, s, > 0."""
    baudrate: int = 19_200
    """Of the serial port, baud."""
    gateway: str = ""
    """On shore: HOST:PORT of the provider's DirectIP gateway, for messages to the modem."""
    imei: str = ""
    """On shore: the modem's number, 15 digits."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value is outside its range.
        """
        if not (self.max_bytes_per_day >= 0 and self.quantum_bytes >= 1):
            raise ValueError("allowed: max_bytes_per_day at least 0, quantum_bytes at least 1")
        if not 0 <= self.price < math.inf:
            raise ValueError(f"price is {self.price}; allowed: at least 0")
        if not _LEAST_MTU_BYTES <= self.mtu <= MOST_SENT_BYTES:
            raise ValueError(f"mtu is {self.mtu}; allowed: {_LEAST_MTU_BYTES}..{MOST_SENT_BYTES}")
        for name in ("give_up_s", "session_s", "check_s"):
            duration_s = getattr(self, name)
            if not is_duration(duration_s, or_zero=name == "check_s"):
                raise ValueError(f"{name} is {duration_s}; allowed: {DURATIONS}")

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
