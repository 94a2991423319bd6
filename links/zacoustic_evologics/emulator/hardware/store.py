"""The settings of a modem: present, stored, and factory settings.

Options of a port (`AT@Z…`, protocol id) are in `port`.
"""

from collections.abc import Mapping
from typing import Final

from zacoustic_evologics.at.firmware import Firmware, label
from zacoustic_evologics.at.replies import SettingsReply, ShownSetting
from zacoustic_evologics.at.settings import SETTINGS

PORT_OPTIONS: Final = ("ZS", "ZF", "ZX", "ZU", "ZA", "ZB")
"""Settings that belong to a port."""

_NAMES: Final = tuple(name for name in SETTINGS if name not in PORT_OPTIONS)


class SettingsStore:
    """The numbers of one modem.

    Args:
        presets: Differences from the factory's settings, also after `AT&F`: a modem keeps the
            address that is printed on it.
    """

    def __init__(self, presets: Mapping[str, int]) -> None:
        self._factory = {name: presets.get(name, SETTINGS[name].default) for name in _NAMES}
        self._stored = dict(self._factory)
        self._values = dict(self._factory)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> int:
        return self._values[name]

    def change(self, name: str, value: int) -> bool:
        """Change a setting if the value is allowed; return whether it is."""
        is_allowed = SETTINGS[name].allows(value)
        if name == "AL":
            is_allowed = is_allowed and value <= self["AM"]
        if name == "AM":
            is_allowed = is_allowed and value >= self["AL"]
        if is_allowed:
            self._values[name] = value
        return is_allowed

    def keep(self) -> None:
        """`AT&W`: settings in force survive a restart."""
        self._stored = dict(self._values)

    def restart(self) -> None:
        """Restore the stored settings."""
        self._values = dict(self._stored)

    def restore(self) -> None:
        """`AT&F`: restore the factory settings."""
        self._values = dict(self._factory)

    def shown(self, firmware: Firmware) -> SettingsReply:
        """Return the answer of `AT&V`."""
        return SettingsReply(
            tuple(
                ShownSetting(label(setting.label, firmware), self[setting.name])
                for setting in SETTINGS.values()
                if setting.label
            )
        )
