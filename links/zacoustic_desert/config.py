"""Settings of the link to DESERT, and the capabilities that follow from them.

DESERT does not describe itself on its socket, so the settings repeat those of its Tcl script. If
they differ, DESERT splits frames (`max_read_length` too large) or queues them without limit
(`period_s` or `listen_s` too small), and nothing reports it.

The time of a packet is the longer of two, since both steps work on different packets at the same
time: the application module passes one packet on in each `period_`, and the medium access listens
before each packet. Then the packet itself follows, with four bytes of headers. Measured at
saturation with the sample script: 2.77 packets of 64 bytes in a second, 2.21 of 512 bytes.
"""

import sys
from typing import Annotated, Final, Literal

from msgspec import Meta

from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.values.rmw_desert.packets import OVERHEAD_BYTES, PAYLOAD_LIMIT_BYTES
from zacoustic.link import LinkConfig

READ_LIMIT_BYTES: Final = 4096
"""Largest `max_read_length` of DESERT, bytes: above it one of its buffers overflows."""
HEADER_BYTES: Final = 4
"""Bytes that DESERT adds to a packet on the air: two of its UDP and two of its IP module."""

# HELLO, addresses, check and delimiters: the minimum of `LinkCapabilities`.
_LEAST_NATIVE_BYTES: Final = 8 + 2 + 4 + 3
_LEAST_PAYLOAD_BYTES: Final = 8 + 2 + 4
_LONGEST: Final = Meta(ge=0, le=3600, title="seconds")


class DesertConfig(LinkConfig, frozen=True, kw_only=True):
    """Settings of the link; they must match DESERT's script."""

    max_read_length: Annotated[int, Meta(ge=_LEAST_NATIVE_BYTES, le=READ_LIMIT_BYTES)] = 64
    """`max_read_length` of the script, bytes; at least 18 with `rmw_desert` framing."""
    period_s: Annotated[float, Meta(gt=0, le=3600, title="seconds")] = 0.2
    """`period_` of the application module, s; DESERT's own default is 10, its samples' 0.2."""
    listen_s: Annotated[float, _LONGEST] = 0.4
    """How long the medium access listens before a packet, s; 0 without CSMA. The sample's CSMA
    takes 0.35 on average; at exactly that the queue in DESERT would still grow."""
    bit_rate_bps: Annotated[float, Meta(gt=0, le=sys.float_info.max)] = 48_000.0
    """Bit rate of the modems in the script, bit/s."""
    latency_s: Annotated[float, _LONGEST] = 1.0
    """From one socket to the other through an idle DESERT, s; the basis of time-outs.
    Measured: 0.7 over one hop, 1.1 over two."""
    framing: Literal["native", "rmw_desert"] = "native"
    """`native`: a byte stream, in which the core delimits frames. `rmw_desert`: that middleware's
    packet around each frame; it has no check of its own."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value outside its range.
        """
        super().__post_init__()
        least = self.least_read_length
        if self.max_read_length < least:
            raise ValueError(
                f"max_read_length is {self.max_read_length}; allowed: {least}..{READ_LIMIT_BYTES}"
            )

    @property
    def least_read_length(self) -> int:
        """Least `max_read_length`, bytes."""
        is_native = self.framing == "native"
        return _LEAST_NATIVE_BYTES if is_native else _LEAST_PAYLOAD_BYTES + OVERHEAD_BYTES

    def capabilities(self) -> LinkCapabilities:
        """The capabilities of the link."""
        is_native = self.framing == "native"
        around_bytes = HEADER_BYTES + (0 if is_native else OVERHEAD_BYTES)
        mtu_bytes = self.max_read_length
        if not is_native:
            mtu_bytes = min(PAYLOAD_LIMIT_BYTES, mtu_bytes - OVERHEAD_BYTES)
        return LinkCapabilities(
            mtu_bytes=mtu_bytes,
            bit_rate_bps=self.bit_rate_bps,
            preamble_s=max(self.period_s, self.listen_s) + around_bytes * 8 / self.bit_rate_bps,
            propagation_s=self.latency_s,
            half_duplex=False,  # the socket is not; DESERT handles its modems
            addressed=False,
            checked=False,
            framed=not is_native,
            controls_access=True,
        )
