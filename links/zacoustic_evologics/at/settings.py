"""The numeric settings of a modem: limits, defaults and meanings.

Where sources disagree, the table has the wider range; a value outside is answered `ERROR OUT OF
RANGE`. A setting that is not in the table may exist; it is not checked.

`prefix` is the first character of the setting's command: `!` changes the modem (until it is
switched off, unless `AT&W` stores it), `@` an option of the port that gets it. Only one port may
change the modem itself: the one that sent `AT@CTRL`, with protocol id 0.
"""

from typing import Final

import msgspec

HIGHEST_ADDRESSES: Final = (2, 6, 14, 30, 62, 126, 254)
"""Values of `AT!AM`; equal in all modems of a fleet, and not below any address in it."""

SOURCE_LEVELS_DB: Final = (0.0, -6.0, -12.0, -20.0)
"""Source levels by the number of `AT!L`, relative to the loudest, dB; the last one is for air."""


class Setting(msgspec.Struct, frozen=True):
    """One setting."""

    name: str
    """As in `AT?NAME`."""
    low: int
    """Lowest value."""
    high: int
    """Highest value."""
    default: int
    """Of a new modem, if a source has it; otherwise a harmless value."""
    label: str = ""
    """Its name in `AT&V`; empty: not shown there."""
    prefix: str = "!"
    """`!` or `@`."""
    choices: tuple[int, ...] = ()
    """The only values, if not all from `low` to `high`."""

    def allows(self, value: int) -> bool:
        """Tell whether the setting can have that value."""
        return self.low <= value <= self.high and (not self.choices or value in self.choices)

    @property
    def allowed(self) -> str:
        """All allowed values, in words."""
        return ", ".join(map(str, self.choices)) or f"{self.low}..{self.high}"


# In the order of `AT&V`, for those that it shows.
_TABLE: Final = (
    Setting("L", 0, 3, 3, "Source Level"),  # 0 loudest, then -6, -12, -20 dB: the only one in air
    Setting("LC", 0, 1, 0, "Source Level Control"),  # the other side may change it
    Setting("G", 0, 1, 0, "Gain"),  # 1 about -20 dB, for short ranges
    Setting("C", 0, 3, 1, "Carrier Waveform ID"),
    Setting("AL", 1, 254, 1, "Local Address"),
    Setting("AM", 2, 254, 14, "Highest Address", choices=HIGHEST_ADDRESSES),
    Setting("ZC", 1, 255, 10, "Cluster Size"),  # packets in a train
    Setting("ZP", 50, 5000, 750, "Packet Time"),  # ms; three sources give three ranges
    Setting("RC", 0, 255, 3, "Retry Count"),  # of a connection
    Setting("RT", 500, 12_000, 1500, "Retry Timeout"),  # ms
    Setting("DA", 0, 3600, 12, "Wake Up Active Time"),  # s
    Setting("DT", 0, 3600, 12, "Wake Up Period"),  # s
    Setting("RP", 0, 1, 0, "Promiscuous Mode"),  # report messages for others
    Setting("CA", 1300, 1700, 1500, "Sound Speed"),  # m/s
    Setting("RI", 0, 255, 1, "IM Retry Count"),  # 255 for ever
    Setting("ZL", 8096, 2_097_152, 16_384, "Pool Size", prefix="@"),  # bytes
    Setting("ZH", 0, 3600, 0, "Hold Timeout"),  # s
    Setting("ZI", 0, 3600, 120, "Idle Timeout"),  # s, 0 never
    Setting("AR", 0, 254, 0),  # remote address of raw bursts, 0 any
    Setting("KO", 0, 255, 0),  # keep-online count
    Setting("DW", 0, 255, 0),  # bits; one source sets 0
    Setting("DR", 0, 255, 0),  # bits
    Setting("UT", 0, 2**32 - 1, 0),  # s, system clock
    Setting("ZS", 0, 7, 0),  # protocol id of this port
    Setting("ZF", 0, 1, 0, prefix="@"),  # extended networking: p<pid> in records
    Setting("ZX", 0, 1, 0, prefix="@"),  # extended notifications
    Setting("ZU", 0, 1, 0, prefix="@"),  # USBL notifications
    Setting("ZA", 0, 1, 0, prefix="@"),  # ECLK notifications, firmware 1.9 and later
    Setting("ZB", 0, 1, 0, prefix="@"),  # a filter of notifications, in one source only
)
SETTINGS: Final = {setting.name: setting for setting in _TABLE}
"""By name."""
KEYS: Final = {
    "AL": "address",
    "AM": "highest_address",
    "L": "source_level",
    "LC": "source_level_control",
    "G": "gain",
    "RI": "retries",
    "CA": "sound_speed_m_s",
}
"""Settings that the driver knows, and their names in a locator and in its diagnostics."""


def refuse_value(name: str, value: int) -> str:
    """Return why a setting cannot have a value, or an empty text."""
    setting = SETTINGS.get(name, Setting(name, 0, 2**32 - 1, 0))
    return "" if setting.allows(value) else f"setting {name} is {value}; allowed: {setting.allowed}"
