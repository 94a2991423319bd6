"""One emulated modem, without ports, sockets or clock.

Its inputs are commands (`handle_command`), raw data (`handle_raw`), sounds (`handle_sound`,
`handle_hearing`) and the time (`handle_timeout`). After any of these the caller takes its messages
(`poll_output`) and its signals (`poll_signal`), each until None, and asks for its next instant
(`poll_timeout`). `now` is ns since the start of the scenario and never decreases.

The parts, from the bottom up: `chassis` (settings, clocks), `transducer` (one signal at a time),
`exchange` (a signal until it is answered), `instant` and `bursts` (the services), `usblhead`,
`levelcontrol`, `listening` (receptions), `queries` (answers). `at.firmware` has the differences
between versions of the modem.
"""

import random
from collections.abc import Callable, Mapping
from typing import Any, Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import BROADCAST
from zacoustic_evologics.airtime import ACKNOWLEDGEMENT_NS
from zacoustic_evologics.at import commands as asked
from zacoustic_evologics.at import refusals
from zacoustic_evologics.at.firmware import Firmware
from zacoustic_evologics.at.messages import Noise
from zacoustic_evologics.at.notifications import PhyOn
from zacoustic_evologics.at.replies import Accepted, CommandReply
from zacoustic_evologics.emulator.exchanges.bursts import Bursts
from zacoustic_evologics.emulator.exchanges.instant import InstantMessages
from zacoustic_evologics.emulator.exchanges.usblhead import UsblHead
from zacoustic_evologics.emulator.hardware.chassis import (
    Behaviour,
    CameUp,
    Chassis,
    Origin,
    Output,
    Said,
    WentDown,
)
from zacoustic_evologics.emulator.hardware.signals import Hearing, Signal, SignalKind
from zacoustic_evologics.emulator.hardware.store import SettingsStore
from zacoustic_evologics.emulator.hardware.transducer import Transducer
from zacoustic_evologics.emulator.modem.actions import Actions
from zacoustic_evologics.emulator.modem.levelcontrol import LevelControl
from zacoustic_evologics.emulator.modem.listening import Listener
from zacoustic_evologics.emulator.modem.queries import Answers, help_text

_RESTARTS: Final = asked.Act(asked.Action.RESET), asked.Act(asked.Action.RESET, 0)


class EmulatedModem:
    """One modem.

    Args:
        settings: Differences from the factory's settings, such as the address `AL`.
        behaviour: Choices where sources disagree.
        rng: Source of all randomness: the start of its clock, errors of fixes, pauses.
    """

    def __init__(
        self, settings: Mapping[str, int], *, behaviour: Behaviour, rng: random.Random
    ) -> None:
        self.is_up = True
        self._chassis = Chassis(SettingsStore(settings), behaviour, rng)
        self._transducer = Transducer(self._chassis, self._handle_sent)
        self._instant = InstantMessages(self._chassis, self._transducer)
        self._bursts = Bursts(self._chassis, self._transducer, self._instant)
        self._instant.has_bursts = lambda: self._bursts.is_sending
        self._head = UsblHead(self._chassis)
        self._listener = Listener(
            self._chassis,
            self._transducer,
            self._instant,
            self._bursts,
            self._head,
            LevelControl(self._chassis),
        )
        self._answers = Answers(self._chassis, self._transducer, self._instant, self._bursts)
        self._actions = Actions(
            self._chassis, self._transducer, self._instant, self._bursts, self._answers
        )

        self._handlers: dict[type, Callable[[Origin, Any, int], CommandReply | Noise]] = {
            asked.SendIm: self._instant.send_im,
            asked.SendIms: self._instant.send_ims,
            asked.SendPbm: self._instant.send_pbm,
            asked.SendBurst: self._bursts.send,
            asked.SendProbe: self._send_probe,
            asked.Query: self._answers.answer,
            asked.Set: self._answers.change,
            asked.SetOption: self._answers.change_option,
            asked.Act: self._actions.act,
            asked.Help: help_text,
        }

    @property
    def address(self) -> int:
        """Network address, the answer to `AT?AL`."""
        return self._chassis.address

    @property
    def firmware(self) -> Firmware:
        """Version of the firmware."""
        return self._chassis.behaviour.firmware

    def clock_us(self, now: int) -> int:
        """Return the answer to `AT?CLOCK`, µs."""
        return self._chassis.clock_us(now)

    def system_us(self, now: int) -> int:
        """Return the system clock, µs."""
        return self._chassis.system_us(now)

    def close_port(self, port_id: int) -> None:
        """Note that a port is gone."""
        self._answers.close_port(port_id)

    def handle_command(self, origin: Origin, command: asked.Command, now: int) -> None:
        """Take a command; exactly one reply precedes its effects, or there is no reply at all."""
        if not self.is_up:
            return
        chassis = self._chassis
        before = len(chassis.outputs)
        if (
            isinstance(command, asked.Act)
            and command.action is asked.Action.RESET
            and not command.value
        ):
            self.restart(now)
            return
        reply = self._execute(origin, command, now)
        if reply is not None:
            chassis.outputs.insert(before, Said(reply, origin.port_id))

    def handle_raw(self, origin: Origin, content: bytes, now: int) -> None:
        """Take raw data of a port in data mode."""
        if self.is_up:
            self._bursts.send_raw(origin, content, now)

    def handle_sound(self, sound: int, now: int) -> None:
        """Note the beginning of a signal that is strong enough to be detected."""
        if self.is_up:
            self._transducer.hear_begin(sound, now)

    def handle_hearing(self, hearing: Hearing, now: int) -> None:
        """Take a signal that has ended here."""
        if not self.is_up:
            return
        if self._transducer.hear_end(hearing):
            self._listener.handle(hearing, now)
        self._look(now)

    def handle_timeout(self, now: int) -> None:
        """Run the due actions."""
        self._chassis.agenda.run(now)
        if self.is_up:
            self._look(now)

    def poll_timeout(self) -> int | None:
        """Return the next due instant, ns; None: none."""
        return self._chassis.agenda.next_at()

    def poll_output(self) -> Output | None:
        """Return the next message of the modem, or None."""
        return self._chassis.outputs.popleft() if self._chassis.outputs else None

    def poll_signal(self) -> Signal | None:
        """Return the next signal that begins now, or None."""
        return self._chassis.signals.popleft() if self._chassis.signals else None

    def restart(self, now: int) -> None:
        """Restart, as by `ATZ0` or by power: only stored settings survive."""
        self.is_up = False
        self._chassis.restart(now)
        self._instant.restart()
        self._bursts.restart()
        self._transducer.restart()
        self._answers.controller = None
        self._chassis.outputs.append(WentDown())
        back_at = now + seconds_to_ns(self._chassis.behaviour.restart_s)
        self._chassis.agenda.push(back_at, self._come_up, back_at)

    def _come_up(self, now: int) -> None:
        self.is_up = True
        self._chassis.started_at = now
        self._chassis.outputs.append(CameUp())
        self._chassis.say(PhyOn())

    def _handle_sent(self, signal: Signal, now: int) -> None:
        self._instant.handle_sent(signal, now)
        self._bursts.handle_sent(signal, now)
        self._look(now)

    def _look(self, now: int) -> None:
        self._instant.look(now)
        self._bursts.look(now)

    def _execute(
        self, origin: Origin, command: asked.Command, now: int
    ) -> CommandReply | Noise | None:
        handler = self._handlers.get(type(command))
        return refusals.UNKNOWN_COMMAND if handler is None else handler(origin, command, now)

    def _send_probe(self, origin: Origin, command: asked.SendProbe, now: int) -> CommandReply:
        transducer = self._transducer
        if not transducer.is_on:
            return refusals.PHY_OFF
        if transducer.is_transmitting(now) or transducer.is_receiving or transducer.owed:
            return refusals.BACKOFF
        transducer.transmit(
            Signal(
                kind=SignalKind.PROBE,
                source=self.address,
                destination=BROADCAST,
                duration_ns=ACKNOWLEDGEMENT_NS,
                number=self._chassis.next_number(),
                bit=command.bit,
                level=self._chassis.store["L"],
            ),
            now,
        )
        return Accepted()
