"""The shore's side of the bridge, as a function of its inputs: it plays the vehicle.

To the ground station this is the autopilot: it sends HEARTBEATs and HIGH_LATENCY2 under the
vehicle's system id. Both rest on samples that have crossed. Each HIGH_LATENCY2 is a new sample;
the HEARTBEAT a second repeats what the last sample said of the mode, for as long as the vehicle is
heard. Without a sample for `lost_after_s` (its age included) both end, one STATUSTEXT says so, and
the ground station raises its own alarm, in QGroundControl "Communication lost". No flag of
HIGH_LATENCY2 is set for that: its flags are the vehicle's words about itself.

A command becomes one call::

        COMMAND_LONG ──> under way: IN_PROGRESS at once, then every second ──> answered: COMMAND_ACK
                          ^ a repetition shares the call                        ^ … or the answer

IN_PROGRESS keeps the ground station from repeating and from giving up; while the vehicle is not
heard there is none, because any message would look like a sign of life. Then a new command is
refused at once, except an abort.

Only the last command has repetitions: once another one was given, the same message is a new
command. A repetition shares the call if it comes while ground stations repeat. Within a minute
after the answer it gets that again, if the ground station says that it is one (`confirmation` > 0).
An abort is never answered so: it goes to the vehicle. A station may always say that it repeats
another command under way.

COMMAND_ACK names the command's id alone. So a command gets none any more once the ground station
has given another one of the id: a text says how it has ended.

The shell calls `handle_*` with instants that never decrease, then `poll` until it returns None,
then sets a timer to `poll_timeout`.
"""

from collections import deque
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.mavlink.commands import (
    IN_PROGRESS,
    Answer,
    GroundCommand,
    Refusal,
    acknowledgement,
    read_command,
)
from zacoustic.mavlink.dialect import AUTOPILOT, Message, Received
from zacoustic.mavlink.entries import ABORT, CLOCK, GIVEN, GROUND
from zacoustic.mavlink.outputs import Call, Notice, Output, Publish, Send
from zacoustic.mavlink.telemetry import heartbeat_of, instruments_of, message_of
from zacoustic.mavlink.unsupported import read_unsupported
from zacoustic.mavlink.vehicletime import VehicleTime

HEARTBEAT_NS: Final = seconds_to_ns(1.0)
"""Period of the HEARTBEAT and of IN_PROGRESS: ground stations wait three seconds for each."""
STATION_SILENCE_NS: Final = seconds_to_ns(5.0)
"""A ground station is gone after this time without its HEARTBEAT: five of them."""
SHARED_NS: Final = seconds_to_ns(3.5)
"""A repetition comes within this time after the last one: ground stations wait three seconds."""
REMEMBERED_NS: Final = seconds_to_ns(60.0)
"""A repetition that says that it is one gets the answer again for this time."""

REFUSED_NS: Final = seconds_to_ns(60.0)
"""The reason of a refusal is told again after this time: stations poll every second."""

_MOST_REFUSED: Final = 100
_GROUND_STATION: Final = 6  # MAV_TYPE_GCS
_CRITICAL, _WARNING = 2, 4  # MAV_SEVERITY
_TEXT_BYTES: Final = 50
_LAST_TEXT: Final = 65535

UNHEARD: Final = Answer("temporarily_rejected", "the vehicle is not heard; nothing was sent")


class _Calling(msgspec.Struct):
    """A command under way."""

    command: GroundCommand
    number: int
    said_at: int
    progress_at: int
    is_earlier: bool = False
    """Whether its acknowledgement would be taken for that of a later command."""


class _Answered(msgspec.Struct, frozen=True):
    """The last command, which has been answered."""

    command: GroundCommand
    answer: Answer
    at: int


class StationSide:
    """Shows the vehicle to a ground station and passes its commands on.

    Args:
        name: What texts call the vehicle.
        ground_every_s: Time between two samples that say that a ground station is there, s.
        lost_after_s: Silence of the vehicle after which it is lost, s.
        is_present: Whether a ground station counts as there without its HEARTBEATs.
        has_instruments: Whether each report is also shown as GLOBAL_POSITION_INT, SYS_STATUS and
            VFR_HUD, for stations that do not read HIGH_LATENCY2.
        now: The instant.
    """

    def __init__(
        self,
        name: str,
        *,
        ground_every_s: float,
        lost_after_s: float,
        is_present: bool = False,
        has_instruments: bool = False,
        now: int,
    ) -> None:
        self._name = name
        self._ground_every_ns = seconds_to_ns(ground_every_s)
        self._lost_after_s = lost_after_s
        self._lost_after_ns = seconds_to_ns(lost_after_s)
        self._is_present = is_present
        self._has_instruments = has_instruments
        self._value: dict[str, Any] | None = None
        self._sampled_at = now
        self._is_lost = False
        self._beat_at: int | None = None
        self._station_at: int | None = None
        self._ground_at: int | None = now if is_present else None
        self._time = VehicleTime()
        self._calling: dict[int, _Calling] = {}
        self._answered: _Answered | None = None
        self._count = 0
        self._texts = 0
        self._refused: dict[str, int] = {}
        self._outputs: deque[Output] = deque()

    # Inputs

    def is_of_other_end(self, received: Received) -> bool:
        """Return whether a message is the HEARTBEAT of a ground station, or a command."""
        if received.message.name == "HEARTBEAT":
            return bool(received.message.fields["type"] == _GROUND_STATION)
        return read_command(received) is not None

    def handle_message(self, received: Received, now: int) -> None:
        """Take a message from the ground station's side."""
        message = received.message
        if message.name == "HEARTBEAT":
            if self.is_of_other_end(received):
                self._hear_station(received, now)
            return
        found = read_command(received)
        if found is None:
            self._refuse_unsupported(received, now)
            return
        if not self._is_for_us(found.target):
            return
        if isinstance(found, Refusal):
            answer = found.answer
            told = f"command {found.command}: {answer.result}, {answer.text}"
            if answer.result == "unsupported":  # its text names the command
                told = f"{answer.text}: {answer.result}"
            self._tell_refusal(told, found.target, now)
            self._send(found.acknowledgement(found.answer), found.target)
        else:
            self._take_command(found, now)

    def handle_telemetry(self, value: dict[str, Any], age_s: float | None, now: int) -> None:
        """Take a sample of the vehicle.

        Args:
            value: The value of the topic.
            age_s: Its age, s; None: not known.
            now: The instant.
        """
        if age_s is None:
            self._say("old", "a sample of unknown age: not shown", is_trouble=True)
            return
        sampled_at = now - seconds_to_ns(min(age_s, 1e9))
        if now - sampled_at >= self._lost_after_ns:
            self._say("old", f"a sample is {age_s:.0f} s old: not shown", is_trouble=True)
            return
        if CLOCK in value:
            self._time.take(value[CLOCK], sampled_at)
        is_new = self._value is None or self._is_lost
        self._value, self._sampled_at, self._is_lost = value, sampled_at, False
        if is_new:
            self._say("vehicle", f"{self._name} is heard: system {value['system']}")
            self._beat_at = now
            self.handle_timeout(now)
        self._send(message_of(value))
        if self._has_instruments:
            for message in instruments_of(value):
                self._send(message)

    def handle_answer(self, number: int, answer: Answer, now: int) -> None:
        """Take the end of a call."""
        calling = self._calling.pop(number)
        command = calling.command
        if number == self._count:
            self._answered = _Answered(command, answer, now)
        told = f"{command.service}: {answer.result}" + (f", {answer.text}" if answer.text else "")
        self._say("answer", told, is_trouble=answer.result != "accepted")
        if calling.is_earlier:
            self._send_text(f"an earlier {told}", _WARNING, command.target)
            return
        if answer.text:
            self._send_text(f"{command.service}: {answer.text}", _WARNING, command.target)
        self._send(command.acknowledgement(answer), command.target)

    def handle_timeout(self, now: int) -> None:
        """Do what is due."""
        self._check_vehicle(now)
        self._check_station(now)
        for calling in self._calling.values():
            if calling.progress_at <= now:
                self._report_progress(calling, now)

    # Outputs

    def poll(self) -> Output | None:
        """Return what the shell has to do next."""
        return self._outputs.popleft() if self._outputs else None

    def poll_timeout(self) -> int | None:
        """Return the instant of the next `handle_timeout`."""
        due = [calling.progress_at for calling in self._calling.values()]
        if self._beat_at is not None:
            due.append(self._beat_at)
        if not self._is_lost:
            due.append(self._sampled_at + self._lost_after_ns)
        if self._ground_at is not None:
            due.append(self._ground_at)
        if self._station_at is not None:
            due.append(self._station_at + STATION_SILENCE_NS)
        return min(due, default=None)

    # Refusals

    def _refuse_unsupported(self, received: Received, now: int) -> None:
        """Answer what does not cross, at once: without an answer it is asked again."""
        found = read_unsupported(received)
        if found is None or not self._is_for_us(found.target):
            return
        self._tell_refusal(found.text, found.target, now)
        if found.answer is not None:
            self._send(found.answer, found.target)

    def _tell_refusal(self, text: str, target: int, now: int) -> None:
        """Say why something is refused; what is asked again and again, once in a while."""
        told_at = self._refused.get(text)
        if told_at is not None and now - told_at < REFUSED_NS:
            return
        if len(self._refused) >= _MOST_REFUSED:
            self._refused.clear()
        self._refused[text] = now
        self._say("refused", text)
        self._send_text(text, _WARNING, target)

    # The vehicle

    def _check_vehicle(self, now: int) -> None:
        """Send the HEARTBEAT of the vehicle, or find that it is lost."""
        is_silent = now - self._sampled_at >= self._lost_after_ns
        if self._value is None:
            if is_silent and not self._is_lost:
                self._is_lost = True
                text = f"{self._name}: no report yet, for {self._lost_after_s:g} s"
                self._say("vehicle_lost", text, is_trouble=True)
        elif self._beat_at is None:
            return
        elif is_silent:
            self._beat_at, self._is_lost = None, True
            text = f"{self._name}: no report for {self._lost_after_s:g} s"
            self._say("vehicle_lost", f"{text}; nothing is shown any more", is_trouble=True)
            self._send_text(text, _CRITICAL)
        elif self._beat_at <= now:
            self._beat_at = now + HEARTBEAT_NS
            self._send(heartbeat_of(self._value))

    # The ground station

    def _hear_station(self, received: Received, now: int) -> None:
        if self._station_at is None:
            self._say("ground_station", f"system {received.system} is heard")
            if self._ground_at is None:
                self._ground_at = now
        self._station_at = now
        self._check_station(now)

    def _check_station(self, now: int) -> None:
        """Tell the vehicle that a ground station is there, or note that it has gone."""
        if self._station_at is not None and now - self._station_at >= STATION_SILENCE_NS:
            self._station_at = None
            text = "no heartbeat of the ground station"
            if self._is_present:
                self._say("ground_station_lost", f"{text}; it counts as present")
            else:
                self._ground_at = None
                self._say(
                    "ground_station_lost", f"{text}: the vehicle is not told", is_trouble=True
                )
        if self._ground_at is not None and self._ground_at <= now:
            self._ground_at = now + self._ground_every_ns
            self._outputs.append(Publish(GROUND, {}))

    # Commands

    def _is_for_us(self, target: int) -> bool:
        return self._value is None or target in (0, self._value["system"])

    def _take_command(self, command: GroundCommand, now: int) -> None:
        calling = self._repeated(command, now)
        last = self._answered
        if calling is not None:
            calling.said_at = now
            self._report_progress(calling, now)
        elif last is not None and _is_repetition(command, last, now):
            self._send(command.acknowledgement(last.answer), command.target)
        elif command.service != ABORT and not self._hears_vehicle(now):
            told = f"{command.service}: {UNHEARD.text}"
            self._say("refused", told, is_trouble=True)
            self._send_text(told, _WARNING, command.target)
            self._send(command.acknowledgement(UNHEARD), command.target)
        else:
            self._call(command, now)

    def _repeated(self, command: GroundCommand, now: int) -> _Calling | None:
        """Return the command under way that is given again."""
        for calling in reversed(self._calling.values()):
            if calling.command.key == command.key:
                is_last = calling.number == self._count and now - calling.said_at < SHARED_NS
                says_so = bool(command.confirmation) and command.service != ABORT
                return calling if is_last or (says_so and not calling.is_earlier) else None
        return None

    def _call(self, command: GroundCommand, now: int) -> None:
        for earlier in self._calling.values():
            if earlier.command.acknowledged_as == command.acknowledged_as:
                earlier.is_earlier = True
        self._answered = None
        self._count += 1
        calling = self._calling[self._count] = _Calling(command, self._count, now, now)
        self._say("command", f"{command.service}: {_told(command.value)}")
        given = self._time.stamp(now)
        value = command.value if given is None else {**command.value, GIVEN: given}
        self._outputs.append(Call(calling.number, command.service, value))
        self._report_progress(calling, now)

    def _report_progress(self, calling: _Calling, now: int) -> None:
        calling.progress_at = now + HEARTBEAT_NS
        command = calling.command
        if calling.is_earlier or self._beat_at is None:
            return
        if not command.form.startswith("MISSION_ITEM"):
            message = acknowledgement(command.command, IN_PROGRESS, command.sender)
            self._send(message, command.target)

    def _hears_vehicle(self, now: int) -> bool:
        return self._value is not None and now - self._sampled_at < self._lost_after_ns

    # Messages

    def _send(self, message: Message, target: int = 0) -> None:
        """Send a message as the vehicle; before it is known, as the system that was addressed."""
        system = target if self._value is None else self._value["system"]
        self._outputs.append(Send(message, system or 1, AUTOPILOT))

    def _send_text(self, text: str, severity: int, target: int = 0) -> None:
        """Send a text, a long one in parts with an id; a part that is not full is the last one."""
        written = text.encode()
        if len(written) <= _TEXT_BYTES:
            self._send(Message("STATUSTEXT", {"severity": severity, "text": written}), target)
            return
        self._texts = self._texts % _LAST_TEXT + 1
        for part, begin in enumerate(range(0, len(written) + 1, _TEXT_BYTES)):
            fields = {"severity": severity, "text": written[begin : begin + _TEXT_BYTES]}
            more = {"id": self._texts, "chunk_seq": part}
            self._send(Message("STATUSTEXT", {**fields, **more}), target)

    def _say(self, event: str, text: str, *, is_trouble: bool = False) -> None:
        self._outputs.append(Notice(event, text, is_trouble))


def _is_repetition(command: GroundCommand, last: _Answered, now: int) -> bool:
    says_so = bool(command.confirmation) and command.service != ABORT
    return says_so and command.key == last.command.key and now - last.at < REMEMBERED_NS


def _told(value: dict[str, Any]) -> str:
    return msgspec.json.encode(value).decode()
