"""The vehicle's side of the bridge, as a function of its inputs: it plays a ground station.

To the autopilot this is a ground station: it sends a HEARTBEAT a second and commands. The
HEARTBEATs go on only while a ground station on shore is heard (`handle_ground`, or a command from
there). When they end, the autopilot's own failsafe acts, as it would on a radio link: ArduPilot's
FS_GCS_…, PX4's NAV_DLL_ACT. Before the first contact there are none, so an autopilot that arms its
failsafe with the first one is not in a failsafe from the start.

The bridge asks for HIGH_LATENCY2 and publishes what comes. If the autopilot refuses, the bridge
composes it of other messages (`composing`).

A command goes to the autopilot (`execution`) while it is fresh. It carries the time of this bridge
at which it was given (`vehicletime`), and is refused after the time-out of its call, when the
station has given up, and after a later command. Without that time it is always fresh: programs on
the vehicle give none. An abort is always fresh.

The shell calls `handle_*` with instants that never decrease, then `poll` until it returns None,
then sets a timer to `poll_timeout`.
"""

from collections import deque
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.mavlink.commands import (
    IN_PROGRESS,
    SET_MESSAGE_INTERVAL,
    Answer,
    answer_of_code,
    command_for_autopilot,
    message_interval,
)
from zacoustic.mavlink.composing import SOURCES, Composer
from zacoustic.mavlink.dialect import AUTOPILOT, Message, Received
from zacoustic.mavlink.entries import (
    ABORT,
    CLOCK,
    GIVEN,
    SERVICES,
    TELEMETRY,
    TEXT_BYTES,
    TIMEOUT_S,
)
from zacoustic.mavlink.execution import EXPIRED, Command, Execution
from zacoustic.mavlink.outputs import Notice, Output, Publish, Reply, Send
from zacoustic.mavlink.telemetry import HIGH_LATENCY2, HIGH_LATENCY2_ID, heartbeat, value_of
from zacoustic.mavlink.vehicletime import PERIOD_MS, later_by

GROUND_COMPONENT: Final = 190
"""Component id of a ground station (MAV_COMP_ID_MISSIONPLANNER)."""

HEARTBEAT_NS: Final = seconds_to_ns(1.0)
"""Period of the HEARTBEAT, as MAVLink recommends it."""
SILENCE_NS: Final = seconds_to_ns(5.0)
"""The autopilot is lost after this time without its HEARTBEAT: five of them."""
AHEAD_MS: Final = 5000
"""A command may seem this much later than it is: rounding, and clocks that differ."""
_MISSED: Final = 3

_INVALID_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID
_GROUND_STATION: Final = 6  # MAV_TYPE_GCS
_WARNING: Final = 4  # MAV_SEVERITY_WARNING


class AutopilotSide:
    """Executes commands at the autopilot and publishes its HIGH_LATENCY2.

    Args:
        interval_s: Time between two samples, s.
        lost_after_s: Silence of the shore after which its HEARTBEATs end, s.
        system: System id of the autopilot; None: the first one that is heard.
        ground_system: System id under which this bridge speaks to the autopilot.
        clock_ms: What this bridge's clock shows, 0..2^32 - 1; drawn at random, so that no time is
            used again after a restart.
        now: The instant.
    """

    def __init__(
        self,
        *,
        interval_s: float,
        lost_after_s: float,
        system: int | None = None,
        ground_system: int = 255,
        clock_ms: int = 0,
        now: int,
    ) -> None:
        self._interval_s = interval_s
        self._interval_ns = seconds_to_ns(interval_s)
        self._lost_after_s = lost_after_s
        self._lost_after_ns = seconds_to_ns(lost_after_s)
        self._wanted_system = system
        self._ground_system = ground_system
        self._system: int | None = None
        self._heartbeat: Message | None = None
        self._heartbeat_at: int | None = None
        self._patient_until: int | None = now + SILENCE_NS
        self._ground_at: int | None = None
        self._beat_at: int | None = None
        self._published_at: int | None = None
        self._asked_at: int | None = None
        self._telemetry_at: int | None = None
        self._complained = False
        self._composer: Composer | None = None
        self._compose_at: int | None = None
        self._execution = Execution(self._send, self._answer)
        self._clock_ms = clock_ms - now // 1_000_000
        self._given: int | None = None
        self._outputs: deque[Output] = deque()

    # Inputs

    def is_of_other_end(self, received: Received) -> bool:
        """Return whether a message is the HEARTBEAT of the autopilot."""
        fields = received.message.fields
        return (
            received.message.name == "HEARTBEAT"
            and received.component == AUTOPILOT
            and received.system == (self._wanted_system or self._system or received.system)
            and fields["autopilot"] != _INVALID_AUTOPILOT
            and fields["type"] != _GROUND_STATION
        )

    def handle_message(self, received: Received, now: int) -> None:
        """Take a message from the autopilot's side."""
        if received.component != AUTOPILOT:
            return
        message = received.message
        if self.is_of_other_end(received):
            self._hear(received, now)
        if received.system != self._system or self._heartbeat is None:
            return
        if self._composer is not None:
            self._composer.take(message, now)
        if message.name == HIGH_LATENCY2:
            self._take_telemetry(message, now)
        elif message.name == "COMMAND_ACK":
            self._take_acknowledgement(received, now)
        elif message.name == "STATUSTEXT":
            self._take_text(message, now)

    def handle_ground(self, now: int) -> None:
        """Note that a ground station is there on shore."""
        if self._ground_at is None or self._beat_at is None:
            self._say("ground_station", "a ground station on shore is heard: heartbeats for it")
            self._beat_at = now
        self._ground_at = now

    def handle_request(
        self,
        number: int,
        service: str,
        value: dict[str, Any],
        client: int | None,
        now: int,
        *,
        timeout_s: float = TIMEOUT_S,
        is_shore: bool = False,
    ) -> None:
        """Execute a command; its answer is a `Reply`.

        Args:
            number: Names the call, ≥ 0.
            service: One of `entries.SERVICES`.
            value: The request.
            client: Acoustic address of the caller; None: on the vehicle.
            now: The instant.
            timeout_s: Time-out of the service, s: how long the command is worth something.
            is_shore: Whether the caller is on shore, so that its call is a sign of life.
        """
        assert service in SERVICES
        where = "" if client is None else f" from node {client}"
        self._say("command", f"{service}{where}: {_told(value)}")
        given = value.get(GIVEN)
        expires_at = None if given is None else self._expires_at(given, timeout_s, now)
        is_late = expires_at is not None and expires_at <= now
        if is_shore and not is_late:
            self.handle_ground(now)
        if service != ABORT and is_late:
            self._reply(number, service, EXPIRED)
        elif not self._is_in_order(service, given, now):
            self._reply(number, service, Answer("superseded", "a later command came first"))
        elif not self._hears_autopilot(now):
            self._reply(number, service, Answer("no_autopilot", "no heartbeat of the autopilot"))
        else:
            self._begin(number, service, value, expires_at, now)

    def handle_timeout(self, now: int) -> None:
        """Do what is due."""
        self._check_silence(now)
        self._check_ground(now)
        self._execution.handle_timeout(now)
        if self._compose_at is not None and self._compose_at <= now:
            self._compose(now)
        missing_at = self._missing_at()
        if missing_at is not None and missing_at <= now:
            self._complain("no HIGH_LATENCY2, nor what makes one, comes from the autopilot")
            self._ask_for_telemetry(now)

    # Outputs

    def poll(self) -> Output | None:
        """Return what the shell has to do next."""
        return self._outputs.popleft() if self._outputs else None

    def poll_timeout(self) -> int | None:
        """Return the instant of the next `handle_timeout`."""
        lost_at = None if self._heartbeat_at is None else self._heartbeat_at + SILENCE_NS
        others = (self._beat_at, lost_at, self._patient_until, self._compose_at, self._missing_at())
        due = [at for at in (self._execution.poll_timeout(), *others) if at is not None]
        return min(due, default=None)

    # The autopilot

    def _hear(self, received: Received, now: int) -> None:
        is_new, self._patient_until = self._heartbeat_at is None, None
        self._system = received.system
        self._heartbeat, self._heartbeat_at = received.message, now
        if is_new:
            self._say("autopilot", f"system {self._system} is heard")
            self._ask_for_telemetry(now)

    def _check_silence(self, now: int) -> None:
        if self._patient_until is not None and self._patient_until <= now:
            self._patient_until = None
            self._say("autopilot_lost", "no autopilot is heard yet", is_trouble=True)
        if self._heartbeat_at is None or self._hears_autopilot(now):
            return
        self._heartbeat_at = self._asked_at = self._compose_at = self._composer = None
        text = f"system {self._system} is silent for {SILENCE_NS / 1e9:g} s: nothing is published"
        self._say("autopilot_lost", text, is_trouble=True)

    def _hears_autopilot(self, now: int) -> bool:
        return self._heartbeat_at is not None and now - self._heartbeat_at < SILENCE_NS

    def _missing_at(self) -> int | None:
        """Return when to ask for telemetry again: the autopilot may have restarted unnoticed."""
        if self._asked_at is None:
            return None
        return max(self._asked_at, self._telemetry_at or 0) + _MISSED * self._interval_ns

    def _ask_for_telemetry(self, now: int) -> None:
        assert self._system is not None
        self._asked_at = now
        self._send(message_interval(HIGH_LATENCY2_ID, self._interval_s, system=self._system))

    def _begin_to_compose(self, refused: str, now: int) -> None:
        assert self._system is not None
        self._say("composed", f"the autopilot has no HIGH_LATENCY2 ({refused}): composed here")
        self._composer = Composer(self._interval_ns)
        self._compose_at = now + self._interval_ns
        for message in SOURCES.values():
            # Twice as often, so that one lost message makes none too old.
            interval = message_interval(message, self._interval_s / 2, system=self._system)
            self._send(interval)

    def _compose(self, now: int) -> None:
        assert self._composer is not None
        assert self._heartbeat is not None
        self._compose_at = now + self._interval_ns
        message = self._composer.compose(self._heartbeat, now)
        if message is not None:
            self._take_telemetry(message, now)

    def _take_telemetry(self, message: Message, now: int) -> None:
        self._telemetry_at, self._complained = now, False
        # An autopilot on another link may send it more often; a sixteenth for its own clock.
        least_ns = self._interval_ns - self._interval_ns // 16
        if self._published_at is not None and now - self._published_at < least_ns:
            return
        if not self._hears_autopilot(now):
            return
        assert self._heartbeat is not None
        assert self._system is not None
        self._published_at = now
        value = value_of(message, self._heartbeat, self._system) | {CLOCK: self._time(now)}
        self._outputs.append(Publish(TELEMETRY, value))

    # The ground station

    def _check_ground(self, now: int) -> None:
        """Send the HEARTBEAT, or end it."""
        if self._beat_at is None or self._beat_at > now:
            return
        assert self._ground_at is not None
        if now - self._ground_at >= self._lost_after_ns:
            self._beat_at = None
            self._say(
                "ground_station_lost",
                f"nothing of shore for {self._lost_after_s:g} s: no more heartbeats, the failsafe "
                "of the autopilot decides",
                is_trouble=True,
            )
            return
        self._beat_at = now + HEARTBEAT_NS
        self._send(heartbeat(_GROUND_STATION, _INVALID_AUTOPILOT))

    # Commands

    def _time(self, now: int) -> int:
        return (self._clock_ms + now // 1_000_000) % PERIOD_MS

    def _expires_at(self, given: int, timeout_s: float, now: int) -> int:
        age_ms = later_by(self._time(now), given)
        if age_ms < -AHEAD_MS:  # by the clock of an earlier run of this bridge
            return now
        return now + seconds_to_ns(timeout_s) - age_ms * 1_000_000

    def _is_in_order(self, service: str, given: int | None, now: int) -> bool:
        """Return whether no later command came before; note this one."""
        if given is None and service == ABORT:
            given = self._time(now)
        if given is None:
            return True
        if self._given is None or later_by(given, self._given) >= 0:
            self._given = given
            return True
        return service == ABORT

    def _begin(
        self, number: int, service: str, value: dict[str, Any], expires_at: int | None, now: int
    ) -> None:
        assert self._system is not None
        assert self._heartbeat is not None
        message = partial(
            command_for_autopilot,
            service,
            value,
            system=self._system,
            autopilot=self._heartbeat.fields["autopilot"],
        )
        if service == ABORT:
            expires_at = None
        self._execution.begin(Command(number, service, message, expires_at), now)

    def _take_acknowledgement(self, received: Received, now: int) -> None:
        fields, sequence = received.message.fields, received.sequence
        ours = {"target_system": self._ground_system, "target_component": GROUND_COMPONENT}
        if any(fields.get(name, 0) not in (0, number) for name, number in ours.items()):
            return  # of another ground station
        is_refused = fields["result"] not in (0, IN_PROGRESS)
        if fields["command"] == SET_MESSAGE_INTERVAL and is_refused and self._composer is None:
            # It does not say of which message: the first refusal is of HIGH_LATENCY2.
            self._begin_to_compose(answer_of_code(fields["result"]).result, now)
        self._execution.handle_acknowledgement(fields["command"], fields["result"], sequence, now)

    def _complain(self, text: str) -> None:
        """Say once that there is no telemetry; again after some has come."""
        if not self._complained:
            self._complained = True
            self._say("no_telemetry", text, is_trouble=True)

    def _take_text(self, message: Message, now: int) -> None:
        fields = message.fields
        if fields["severity"] <= _WARNING and not fields.get("chunk_seq"):
            self._execution.handle_text(str(fields["text"]), now)

    def _answer(self, command: Command, answer: Answer) -> None:
        self._reply(command.number, command.service, answer)

    def _reply(self, number: int, service: str, answer: Answer) -> None:
        told = f"{service}: {answer.result}" + (f", {answer.text}" if answer.text else "")
        self._say("answer", told, is_trouble=answer.result != "accepted")
        self._outputs.append(Reply(number, answer))

    def _send(self, message: Message) -> None:
        self._outputs.append(Send(message, self._ground_system, GROUND_COMPONENT))

    def _say(self, event: str, text: str, *, is_trouble: bool = False) -> None:
        self._outputs.append(Notice(event, text, is_trouble))


def answer_value(answer: Answer) -> dict[str, Any]:
    """Return the answer of a service; its text is cut to what fits."""
    value = {"success": answer.result == "accepted", "result": answer.result}
    text = answer.text.encode()[:TEXT_BYTES].decode(errors="ignore")
    return {**value, "text": text or None}


def _told(value: dict[str, Any]) -> str:
    """Return a request in one line, without what is missing."""
    shown = {name: each for name, each in value.items() if each is not None and name != GIVEN}
    return msgspec.json.encode(shown).decode()
