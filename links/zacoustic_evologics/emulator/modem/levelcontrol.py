"""`AT!LC1`: the source level follows from the received level at the other modem.

Sources say that the source level changes then and that `SRCLEVEL` reports it, but give no rule.
Here the answer of another modem tells the level at which it received this one: the distance is the
same in both directions, and an answer carries its own source level. The limits are those of useful
levels, -85…-20, slightly inside at the loud end, where the receiver reports -20 for all that is
louder.
"""

from typing import Final

from zacoustic_evologics.at.notifications import SourceLevel
from zacoustic_evologics.at.settings import SOURCE_LEVELS_DB
from zacoustic_evologics.emulator.hardware.chassis import Chassis
from zacoustic_evologics.emulator.hardware.signals import Hearing

TOO_LOUD_DB: Final = -25
"""Above this level at the other modem, a modem becomes one step quieter; dB re 1 V."""
TOO_QUIET_DB: Final = -85
"""Below it, one step louder; dB re 1 V."""


class LevelControl:
    """The source level of one modem.

    Args:
        chassis: Chassis of the modem.
    """

    def __init__(self, chassis: Chassis) -> None:
        self._chassis = chassis

    def handle_answer(self, hearing: Hearing) -> None:
        """Adapt the level to an answer."""
        store = self._chassis.store
        if not store["LC"]:
            return
        level, theirs = store["L"], hearing.signal.level
        heard_db = hearing.rssi_db - SOURCE_LEVELS_DB[theirs] + SOURCE_LEVELS_DB[level]
        step = int(heard_db > TOO_LOUD_DB) - int(heard_db < TOO_QUIET_DB)
        if step and store.change("L", level + step):
            self._chassis.say(SourceLevel(store["L"]))
