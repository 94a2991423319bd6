"""A modem's answers to queries and settings."""

import math
from collections.abc import Callable
from typing import Final

from zacoustic_evologics.at import refusals, replies
from zacoustic_evologics.at.commands import Help, Query, Set, SetOption
from zacoustic_evologics.at.firmware import knows_control
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.messages import Noise
from zacoustic_evologics.at.notifications import ClockOffset, RemoteAddress
from zacoustic_evologics.at.settings import SETTINGS
from zacoustic_evologics.emulator.exchanges.bursts import Bursts
from zacoustic_evologics.emulator.exchanges.instant import InstantMessages
from zacoustic_evologics.emulator.hardware.chassis import Chassis, Origin
from zacoustic_evologics.emulator.hardware.transducer import PhyState, Transducer

_BATTERY_V: Final = 24.1
_PATHS: Final = 8
_FIRST_PATH: Final = replies.Path(0, 240)
_NO_PATH: Final = replies.Path(0, 0)
_NOISE: Final = Noise(first=250_000, second=0, third=-85, payload=bytes(64))


class Answers:
    """Reads and changes the numbers of one modem.

    Args:
        chassis: Chassis of the modem.
        transducer: Transducer of the modem.
        instant: Its messages.
        bursts: Its connections.
    """

    def __init__(
        self,
        chassis: Chassis,
        transducer: Transducer,
        instant: InstantMessages,
        bursts: Bursts,
    ) -> None:
        # The port that may change the modem; None: any.
        self.controller: int | None = None
        self._chassis = chassis
        self._transducer = transducer
        self._instant = instant
        self._bursts = bursts
        self._numbers: dict[str, Callable[[], int]] = {
            "T": lambda: chassis.measured.propagation_us,
            "I": lambda: chassis.measured.integrity,
            "BL": lambda: chassis.measured.local_bps,
            "BR": lambda: chassis.measured.remote_bps,
            "PC": lambda: bursts.pool.counter,
            "ZE": lambda: chassis.measured.delivered_raw_bytes,
            "ZD": lambda: chassis.measured.dropped_bytes,
            "ZO": lambda: 0,
            "PS": lambda: int(transducer.is_on),
            "TX": lambda: 0,
        }
        self._decimals: dict[str, Callable[[], float]] = {
            "E": lambda: float(chassis.measured.rssi_db),
            "V": lambda: chassis.measured.velocity_m_s,
            "BV": lambda: _BATTERY_V,
        }

    def answer(self, origin: Origin, query: Query, now: int) -> replies.CommandReply | Noise:
        """`AT?…`, except for queries about the port."""
        name = query.name
        if name in self._numbers:
            return replies.Number(self._numbers[name]())
        if name in self._decimals:
            return replies.Measurement(self._decimals[name]())
        match name:
            case "S":
                return self._status(origin)
            case "DI":
                return replies.DeliveryReply(self._instant.state)
            case "CLOCK":
                return replies.Number(self._chassis.clock_us(now))
            case "UT" | "UTX":
                return replies.Number(self._chassis.system_us(now) // 1_000_000)
            case "P":
                return self._multipath()
            case "UP":
                return self._chassis.measured.body_position or refusals.OUT_OF_CONTEXT
            case "UPX":
                return self._chassis.measured.earth_position or refusals.OUT_OF_CONTEXT
            case "NOISE":
                return _NOISE
            case "CTRL" if knows_control(self._chassis.behaviour.firmware):
                return replies.Number(int(self.controller == origin.port_id))
            case _ if name in self._chassis.store:
                return replies.Number(self._chassis.store[name])
            case _:
                return refusals.UNKNOWN_COMMAND

    def change(self, origin: Origin, command: Set, now: int) -> replies.CommandReply:
        """`AT!…`."""
        name = command.name
        if name not in self._chassis.store:
            return refusals.UNKNOWN_COMMAND
        if not self._may_change(origin):
            return refusals.NO_CONTROL
        if name == "ZL" and self._bursts.pool:
            return refusals.BUFFERS_NOT_EMPTY
        if name == "UT":
            if not SETTINGS[name].allows(command.value):
                return refusals.OUT_OF_RANGE
            before_us = self._chassis.system_us(now)
            self._chassis.set_system_s(command.value, now)
            self._chassis.say(ClockOffset(self._chassis.system_us(now) - before_us))
            return replies.Accepted()
        if not self._chassis.store.change(name, command.value):
            return refusals.OUT_OF_RANGE
        if name == "AR":
            self._chassis.say(RemoteAddress(command.value))
        return replies.Accepted()

    def change_option(self, origin: Origin, command: SetOption, now: int) -> replies.CommandReply:
        """`AT@…`, except for options of the port."""
        has_control = knows_control(self._chassis.behaviour.firmware)
        match command.name, command.value:
            case "CTRL", None if has_control:
                if origin.pid != 0:
                    return refusals.NO_CONTROL
                self.controller = origin.port_id
                return replies.Accepted()
            case "ZD", None:
                self._chassis.measured.dropped_bytes = 0
                return replies.Accepted()
            case "ZO", None:
                return replies.Accepted()
            case "ZL", int(size):
                return self.change(origin, Set("ZL", size), now)
            case _:
                return refusals.WRONG_FORMAT

    def may_store(self, origin: Origin) -> bool:
        """Whether a port may store or restore the settings."""
        return self._may_change(origin)

    def close_port(self, port_id: int) -> None:
        """Take control from a closed port."""
        if self.controller == port_id:
            self.controller = None

    def _may_change(self, origin: Origin) -> bool:
        if origin.pid != 0:
            return False
        if self.controller is None:
            return not self._chassis.behaviour.strict_control
        return self.controller == origin.port_id

    def _status(self, origin: Origin) -> replies.CommandReply:
        state = self._transducer.state.value
        if self._transducer.state is PhyState.LISTEN:
            state = self._bursts.state or state
        free_bytes = self._bursts.pool.free_bytes
        if origin.interpreter is Interpreter.AT:
            return replies.LinkStatus(state, (free_bytes,))
        return replies.NetStatus(
            local_address=self._chassis.address,
            remote_address=self._chassis.store["AR"],
            state=state,
            pool=f"{len(self._bursts.pool)} packets : {free_bytes} bytes free",
            promiscuous=self._chassis.store["RP"] == 1,
        )

    def _multipath(self) -> replies.MultipathReply:
        """Return the direct path and its weaker echoes; none before the first reception."""
        if not self._chassis.measured.integrity:
            return replies.MultipathReply((_NO_PATH,) * _PATHS)
        echoes = tuple(
            replies.Path(round(400 * math.sqrt(order)) * order, _FIRST_PATH.strength >> order)
            for order in range(1, 4)
        )
        return replies.MultipathReply((_FIRST_PATH, *echoes, *(_NO_PATH,) * (_PATHS - 4)))


def help_text(origin: Origin, command: Help, now: int) -> replies.TextReply:
    """`AT…$`."""
    setting = SETTINGS.get(command.key.lstrip("?!@&%*"))
    if setting is None:
        return replies.TextReply(f"{command.key}: no help\n")
    label = setting.label or setting.name
    return replies.TextReply(f"{command.key}: {label}\nrange: {setting.low}..{setting.high}\n")
