"""The commands of one letter, except for the restart, which `modem` handles."""

from typing import Final

from zacoustic_evologics.at import refusals
from zacoustic_evologics.at.commands import Act, Action
from zacoustic_evologics.at.notifications import PhyOff, PhyOn
from zacoustic_evologics.at.replies import Accepted, CommandReply, LinkStatus, TextReply
from zacoustic_evologics.emulator.exchanges.bursts import Bursts
from zacoustic_evologics.emulator.exchanges.instant import InstantMessages
from zacoustic_evologics.emulator.hardware.chassis import Chassis, Origin
from zacoustic_evologics.emulator.hardware.transducer import PhyState, Transducer
from zacoustic_evologics.emulator.modem.queries import Answers

_INFORMATION: Final = {
    0: "{firmware}",
    1: "phy:emulated 0.1, mac:d-mac v{firmware}",
    2: "EMULATED",
    7: "zacoustic emulator",
}
_STATES: Final = {
    Action.LISTEN: PhyState.LISTEN,
    Action.MEASURE_NOISE: PhyState.NOISE,
    Action.DEAF: PhyState.DEAF,
}


class Actions:
    """Executes the actions of one modem.

    Args:
        chassis: Chassis of the modem.
        transducer: Transducer of the modem.
        instant: Its messages.
        bursts: Its connections.
        answers: Knows which port may change the modem.
    """

    def __init__(
        self,
        chassis: Chassis,
        transducer: Transducer,
        instant: InstantMessages,
        bursts: Bursts,
        answers: Answers,
    ) -> None:
        self._chassis = chassis
        self._transducer = transducer
        self._instant = instant
        self._bursts = bursts
        self._answers = answers

    def act(self, origin: Origin, command: Act, now: int) -> CommandReply:
        """Execute an action and return the reply."""
        action, value = command.action, command.value
        match action:
            case Action.LISTEN | Action.MEASURE_NOISE | Action.DEAF:
                return self._enter(_STATES[action])
            case Action.PHYSICAL:
                self._instant.drop()
                self._bursts.drop()
                self._transducer.state = PhyState.OFF
                self._chassis.say(PhyOff())
                return Accepted()
            case Action.RESET:
                return self._reset(value)
            case Action.CONNECT:
                return self._connect(value, now)
            case Action.HANG_UP:
                self._bursts.drop()
                return Accepted()
            case Action.INFORMATION:
                text = _INFORMATION.get(value or 0)
                if text is None:
                    return refusals.OUT_OF_RANGE
                return TextReply(text.format(firmware=self._chassis.behaviour.firmware))
            case Action.SHOW_SETTINGS:
                return self._chassis.store.shown(self._chassis.behaviour.firmware)
            case Action.STORE_SETTINGS | Action.FACTORY_SETTINGS:
                return self._store(action, origin)
            case Action.COMMAND_MODE | Action.DATA_MODE:
                return refusals.UNKNOWN_COMMAND
            case Action.ATTENTION:
                return Accepted()

    def _enter(self, state: PhyState) -> CommandReply:
        was_on = self._transducer.is_on
        self._transducer.state = state
        if not was_on:
            self._chassis.say(PhyOn())
        return LinkStatus(state.value)

    def _reset(self, value: int | None) -> CommandReply:
        match value:
            case 1:
                self._bursts.drop()
            case 3:
                self._instant.drop()
            case 4:
                self._instant.drop()
                self._bursts.drop()
            case 2:
                pass
            case _:
                return refusals.OUT_OF_RANGE
        return Accepted()

    def _connect(self, value: int | None, now: int) -> CommandReply:
        destination = self._chassis.store["AR"] if value is None else value
        if not self._transducer.is_on:
            return refusals.PHY_OFF
        if destination == 0:
            return refusals.OUT_OF_CONTEXT
        if destination == self._chassis.address or not destination <= self._chassis.store["AM"]:
            return refusals.WRONG_DESTINATION
        if now < self._transducer.backoff_until:
            return refusals.BACKOFF
        self._bursts.connect(destination, now)
        return Accepted()

    def _store(self, action: Action, origin: Origin) -> CommandReply:
        if not self._answers.may_store(origin):
            return refusals.NO_CONTROL
        if action is Action.STORE_SETTINGS:
            self._chassis.store.keep()
        else:
            self._chassis.store.restore()
        return Accepted()
