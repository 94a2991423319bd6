"""Settings of the driver: the part of its locator after `#`."""

from typing import Annotated, Final, Literal, TypeAlias

from msgspec import Meta

from zacoustic.link import LinkConfig
from zacoustic_evologics.at.fields import BURST_LIMIT_BYTES, IM_LIMIT_BYTES
from zacoustic_evologics.at.settings import KEYS, SETTINGS

IN_AIR_SOURCE_LEVEL: Final = 3
"""The quietest level, 20 dB below the loudest; the only one that a transducer in air survives."""

_Time: TypeAlias = Annotated[float, Meta(gt=0, le=3600, title="seconds")]


class EvologicsConfig(LinkConfig, frozen=True, kw_only=True):
    """Settings of the driver. It leaves a setting that is None here as it is in the modem.

    It stores nothing in the modem (`AT&W`): its settings last until the modem is switched off.
    """

    baudrate: Annotated[int, Meta(ge=300, le=4_000_000)] = 19_200
    """Of a serial port, baud."""
    service: Literal["auto", "im", "ims", "pbm", "burst"] = "auto"
    """What carries frames. `im`: instant messages. `ims`: synchronous instant messages, which carry
    the instant of their start and are never acknowledged. `pbm`: piggyback messages to one
    receiver, never acknowledged; they wait up to `busy_s` until the modem answers that receiver,
    and are rejected if it does not. `burst`: burst data to one receiver. `auto`: instant messages
    up to 64 bytes, burst data above, and a piggyback message if that is sooner: to a modem that
    awaits an acknowledgement."""
    bulk: bool | None = None
    """Whether large samples to one node go as burst data, beside instant messages for all else;
    only with `service` `auto` and `mtu` up to 64, where it is the default."""
    mtu: Annotated[int, Meta(ge=16, le=BURST_LIMIT_BYTES)] = IM_LIMIT_BYTES
    """Largest frame, bytes; at most 64 without burst data. Frames above 64 need one receiver:
    burst data has no broadcast."""
    check: bool = False
    """The core adds a check to each frame, a CRC-32 of 4 bytes; equal in all nodes of a fleet.

    The modem protects the acoustic channel, the network protects TCP. A serial cable protects
    nothing, and the modem's grammar has no check: a received message with a wrong bit, or one that
    is cut short and takes its rest from the next, looks like any other. Leave it off on TCP and on
    a short cable indoors, where bytes lost or added *between* messages are detected anyway. Set it
    if a serial line is long, runs beside thrusters or through a slip ring, or has a high baud rate
    without handshake, or if `unrecognised` grows in `diagnostics`."""
    set_address: bool = False
    """Set the modem's address to that of this node; otherwise another address is an error."""
    highest_address: int | None = None
    """Highest address of the network, `AT!AM`, equal in all modems: 2, 6, 14, 30, 62, 126, 254."""
    source_level: int | None = None
    """0 the loudest, then 1: -6 dB, 2: -12 dB, 3: -20 dB."""
    deck: bool = False
    """The transducer is in air: source level 3 whatever the modem's setting, set again before each
    frame; no link if it cannot be set."""
    gain: int | None = None
    """Gain of the receiver: 0 normal, 1 low, for short ranges."""
    retries: Annotated[int, Meta(ge=0, le=10)] = 0
    """Repetitions of an unacknowledged instant message by the modem. Repetitions can arrive
    twice; the core retransmits by itself."""
    extended_notifications: bool = True
    """The modem reports when sounds begin and end, `AT@ZX1`. Without it, the driver asks by `AT?DI`
    whether a message has left, and the link lacks `senses_carrier`."""
    usbl: bool = True
    """A modem with an ultra-short baseline head reports positions of others, `AT@ZU1`."""
    propagation_s: _Time = 1.0
    """Longest propagation delay, one way, s: 1 s is 1500 m."""
    busy_s: Annotated[float, Meta(ge=0, le=3600, title="seconds")] = 10.0
    """How long a frame may wait while the modem answers BUSY, or for an opportunity, s."""
    reply_s: _Time = 1.0
    """Time limit of an answer, s, besides the time on a serial port."""
    wait_s: _Time = 15.0
    """Time for which `open` waits for the modem, s; it boots in about 5 s."""

    @property
    def has_bulk(self) -> bool:
        """Whether large samples to one node go as burst data."""
        is_possible = self.service == "auto" and self.mtu <= IM_LIMIT_BYTES
        return is_possible if self.bulk is None else self.bulk

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value is outside its range, or two contradict each other.
        """
        super().__post_init__()
        if self.mtu > IM_LIMIT_BYTES and self.service not in ("auto", "burst"):
            raise ValueError(
                f"mtu is {self.mtu} with service {self.service}; allowed: 16..{IM_LIMIT_BYTES}"
            )
        if self.bulk and (self.service != "auto" or self.mtu > IM_LIMIT_BYTES):
            raise ValueError(
                f"bulk is true with service {self.service} and mtu {self.mtu}; it needs service "
                f"auto and an mtu of at most {IM_LIMIT_BYTES}"
            )
        for name in ("AM", "L", "G"):
            setting, value = SETTINGS[name], getattr(self, KEYS[name])
            if value is not None and not setting.allows(value):
                raise ValueError(f"{setting.label.lower()} is {value}; allowed: {setting.allowed}")
        if self.deck and self.source_level not in (None, IN_AIR_SOURCE_LEVEL):
            raise ValueError(
                f"source_level is {self.source_level} on deck; allowed: {IN_AIR_SOURCE_LEVEL}"
            )
        if self.service == "pbm" and not self.extended_notifications:
            raise ValueError("service is pbm; extended_notifications must be true")
