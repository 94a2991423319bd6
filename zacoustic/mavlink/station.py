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
heard there is none, because any message would look like a sign of life. A repetition after the
answer gets the answer again, unless another command of the service came in between: then it is a
new command. It is one if the ground station says so (`confirmation` > 0) within a minute or, in
messages that cannot say it, if it comes within five seconds.

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
from zacoustic.mavlink.entries import GROUND
from zacoustic.mavlink.outputs import Call, Notice, Output, Publish, Send
from zacoustic.mavlink.telemetry import heartbeat_of, message_of

HEARTBEAT_NS: Final = seconds_to_ns(1.0)
"""Period of the HEARTBEAT and of IN_PROGRESS: ground stations wait three seconds for each."""
STATION_SILENCE_NS: Final = seconds_to_ns(5.0)
"""A ground station is gone after this time without its HEARTBEAT: five of them."""
REPEAT_NS: Final = seconds_to_ns(5.0)
"""A repetition comes within this time after the answer: ground stations wait three seconds."""
CONFIRMED_NS: Final = seconds_to_ns(60.0)
"""The same for a command that says that it is a repetition."""

_GROUND_STATION: Final = 6  # MAV_TYPE_GCS
_CRITICAL, _WARNING = 2, 4  # MAV_SEVERITY
_TEXT_BYTES: Final = 50
_LAST_TEXT: Final = 65535
_ORDERS: Final = 2**16


class _Calling(msgspec.Struct):
    """A command under way."""

    command: GroundCommand
    number: int
    progress_at: int


class _Answered(msgspec.Struct, frozen=True):
    """The last answered command of a service."""

    command: GroundCommand
    answer: Answer
    at: int


class StationSide:
    """Shows the vehicle to a ground station and passes its commands on.

    Args:
        name: What texts call the vehicle.
        run: Number of this run, 0..65535, drawn at random.
        ground_every_s: Time between two samples that say that a ground station is there, s.
        lost_after_s: Silence of the vehicle after which it is lost, s.
        is_present: Whether a ground station counts as there without its HEARTBEATs.
        now: The instant.
    """

    def __init__(
        self,
        name: str,
        *,
        run: int,
        ground_every_s: float,
        lost_after_s: float,
        is_present: bool = False,
        now: int,
    ) -> None:
        self._name = name
        self._run = run
        self._ground_every_ns = seconds_to_ns(ground_every_s)
        self._lost_after_s = lost_after_s
        self._lost_after_ns = seconds_to_ns(lost_after_s)
        self._is_present = is_present
        self._value: dict[str, Any] | None = None
        self._sampled_at = now
        self._is_lost = False
        self._beat_at: int | None = None
        self._station_at: int | None = None
        self._ground_at: int | None = now if is_present else None
        self._calling: dict[tuple[object, ...], _Calling] = {}
        self._answered: dict[str, _Answered] = {}
        self._count = 0
        self._texts = 0
        self._outputs: deque[Output] = deque()

    # Inputs

    def handle_message(self, received: Received, now: int) -> None:
        """Take a message from the ground station's side."""
        message = received.message
        if message.name == "HEARTBEAT":
            if message.fields["type"] == _GROUND_STATION:
                self._hear_station(received, now)
            return
        found = read_command(received)
        if found is None or not self._is_for_us(found.target):
            return
        if isinstance(found, Refusal):
            self._say("refused", f"{found.command}: {found.answer.result}, {found.answer.text}")
            self._send(found.acknowledgement(), found.target)
        else:
            self._take_command(found, now)

    def handle_telemetry(self, value: dict[str, Any], age_s: float | None, now: int) -> None:
        """Take a sample of the vehicle.

        Args:
            value: The value of the topic.
            age_s: Its age, s; None: not known.
            now: The instant.
        """
        sampled_at = now - round(min(age_s or 0.0, 1e9) * 1e9)
        if now - sampled_at >= self._lost_after_ns:
            self._say("old", f"a sample is {age_s or 0:.0f} s old: not shown", is_trouble=True)
            return
        is_new = self._value is None or self._is_lost
        self._value, self._sampled_at, self._is_lost = value, sampled_at, False
        if is_new:
            self._say("vehicle", f"{self._name} is heard: system {value['system']}")
            self._beat_at = now
            self.handle_timeout(now)
        self._send(message_of(value))

    def handle_answer(self, number: int, answer: Answer, now: int) -> None:
        """Take the end of a call."""
        calling = next(each for each in self._calling.values() if each.number == number)
        command = calling.command
        del self._calling[command.key]
        self._answered[command.service] = _Answered(command, answer, now)
        told = f"{command.service}: {answer.result}" + (f", {answer.text}" if answer.text else "")
        self._say("answer", told, is_trouble=answer.result != "accepted")
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
        calling = self._calling.get(command.key)
        if calling is not None:
            self._report_progress(calling, now)
            return
        last = self._answered.get(command.service)
        if last is not None and _is_repetition(command, last, now):
            self._send(command.acknowledgement(last.answer), command.target)
            return
        # Another command of the service: what comes after it is no repetition any more.
        self._answered.pop(command.service, None)
        self._count += 1
        if self._count == _ORDERS:  # more commands than a run can count
            self._run, self._count = (self._run + 1) % _ORDERS, 1
        calling = _Calling(command, self._count + self._run * _ORDERS, now)
        self._calling[command.key] = calling
        self._say("command", f"{command.service}: {_told(command.value)}")
        value = {**command.value, "order": calling.number}
        self._outputs.append(Call(calling.number, command.service, value))
        self._report_progress(calling, now)

    def _report_progress(self, calling: _Calling, now: int) -> None:
        calling.progress_at = now + HEARTBEAT_NS
        command = calling.command
        if self._beat_at is not None and not command.form.startswith("MISSION_ITEM"):
            message = acknowledgement(command.command, IN_PROGRESS, command.sender)
            self._send(message, command.target)

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
    if command.key != last.command.key:
        return False
    if command.confirmation is None:
        return now - last.at < REPEAT_NS
    return command.confirmation > 0 and now - last.at < CONFIRMED_NS


def _told(value: dict[str, Any]) -> str:
    return msgspec.json.encode(value).decode()
