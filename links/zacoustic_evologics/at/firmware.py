"""Differences between the modem's firmwares, as far as drivers have met them.

========  ==========================================================================================
up to 1.6 RECVIM and RECVPBM have bit rate and propagation delay instead of the duration
up to 1.7 no `AT@CTRL`: any port changes the modem; `AT&V` misspells one label
up to 1.8 no external clock, `AT@ZA`
========  ==========================================================================================
"""

from typing import Final, Literal, TypeAlias, get_args

Firmware: TypeAlias = Literal["1.6", "1.7", "1.8", "1.9"]
"""Answer of `ATI0`."""
FIRMWARES: Final[tuple[str, ...]] = get_args(Firmware)
"""Firmwares whose peculiarities are known."""
IM_BIT_RATE_BPS: Final = 976
"""Bit rate of a message as reported by older firmware, bit/s."""

_MISSPELT: Final = {"IM Retry Count": "IM Rerty Count"}


def tells_delays(firmware: Firmware) -> bool:
    """Whether reports of messages have bit rate and delay instead of the duration."""
    return firmware == "1.6"


def knows_control(firmware: Firmware) -> bool:
    """Whether one port can take exclusive control of the modem."""
    return firmware not in ("1.6", "1.7")


def knows_external_clock(firmware: Firmware) -> bool:
    """Whether the external clock can be reported."""
    return firmware == "1.9"


def label(text: str, firmware: Firmware) -> str:
    """Return the name of a setting in `AT&V`."""
    return text if knows_control(firmware) else _MISSPELT.get(text, text)
