"""What differs between the firmwares of the modem, as far as drivers have met it.

========  ==========================================================================================
up to 1.6 RECVIM and RECVPBM have bit rate and propagation delay instead of the duration
up to 1.7 no `AT@CTRL`: any port changes the modem; `AT&V` misspells one label
up to 1.8 no external clock, `AT@ZA`
========  ==========================================================================================
"""

from typing import Final, Literal, TypeAlias

Firmware: TypeAlias = Literal["1.6", "1.7", "1.8", "1.9"]
"""What `ATI0` answers."""
IM_BIT_RATE_BPS: Final = 976
"""What an older firmware calls the bit rate of a message."""

_MISSPELT: Final = {"IM Retry Count": "IM Rerty Count"}


def tells_delays(firmware: Firmware) -> bool:
    """Whether messages come with bit rate and delay instead of their duration."""
    return firmware == "1.6"


def knows_control(firmware: Firmware) -> bool:
    """Whether one port can have the modem for itself."""
    return firmware not in ("1.6", "1.7")


def knows_external_clock(firmware: Firmware) -> bool:
    """Whether the external clock can be notified."""
    return firmware == "1.9"


def label(text: str, firmware: Firmware) -> str:
    """Return how `AT&V` calls a setting."""
    return text if knows_control(firmware) else _MISSPELT.get(text, text)
