"""The modems of a `VirtualNetwork`: what they do by themselves."""

from typing import Final

import msgspec

from zacoustic.channel.modems import Station
from zacoustic.channel.profiles import ModemProfile
from zacoustic.core.base.linktypes import BROADCAST, LinkCapabilities, Transmission
from zacoustic.testing.virtualnode import VirtualNode

MEASURED: Final = frozenset({"snr_db", "propagation_s", "range_m"})
"""Fields of `LinkMetrics` that an acknowledgement fills."""


class Device(Station[Transmission]):
    """The modem of one node.

    Args:
        node: The computer that it belongs to.
        profile: What modem it is.
    """

    __slots__ = ("is_unserved", "node")

    def __init__(self, node: VirtualNode, profile: ModemProfile) -> None:
        super().__init__(node.address, profile)
        self.node = node
        self.is_unserved = False
        """The engine has got an input, and was not polled since."""


class Modem(msgspec.Struct, frozen=True, kw_only=True):
    """What the modems of a network do by themselves."""

    addressed: bool = True
    """Frames carry their addresses."""
    checked: bool = True
    """Damaged frames do not arrive."""
    framed: bool = True
    """Frames arrive as frames; otherwise as a byte stream."""
    senses_carrier: bool = True
    """It reports the beginning and the end of a reception."""
    acknowledges: bool = False
    """Frames that ask for it are acknowledged, and the range is measured by that."""
    mtu_bytes: int | None = None
    """Largest frame, bytes; None: the profile's."""

    def capabilities(self, profile: ModemProfile, propagation_s: float) -> LinkCapabilities:
        """Return what a modem of that profile can do then.

        Args:
            profile: The modem.
            propagation_s: Longest propagation delay, one way, s.
        """
        return LinkCapabilities(
            mtu_bytes=self.mtu_bytes or profile.mtu_bytes,
            bit_rate_bps=profile.bit_rate_bps,
            preamble_s=profile.preamble_s,
            gap_s=profile.gap_s,
            propagation_s=propagation_s,
            half_duplex=profile.half_duplex,
            addressed=self.addressed,
            checked=self.checked,
            framed=self.framed,
            acknowledges=self.acknowledges,
            measures=MEASURED if self.acknowledges else frozenset(),
            measures_range=self.acknowledges,
            senses_carrier=self.senses_carrier and not profile.separates_senders,
        )

    def answers(self, transmission: Transmission) -> bool:
        """Tell whether a frame is acknowledged by the modem that receives it."""
        asks = transmission.acknowledge and transmission.destination != BROADCAST
        return self.acknowledges and asks
