"""The vehicle's side of the bridge, as a function of its inputs: it plays a ground station.

To the autopilot this is a ground station: it sends a HEARTBEAT a second and commands. The
HEARTBEATs go on only while a ground station on shore is heard (`handle_ground`, or a command from
there). When they end, the autopilot's own failsafe acts, as it would on a radio link: ArduPilot's
FS_GCS_…, PX4's NAV_DLL_ACT. Before the first contact there are none, so an autopilot that arms its
failsafe with the first one is not in a failsafe from the start.

The bridge asks for HIGH_LATENCY2 and publishes what comes. If the autopilot refuses, the bridge
composes it of other messages (`composing`).

A command is sent until it is acknowledged, as MAVLink demands: an acknowledgement names only the
command's id, so commands of one id go one after the other.

The shell calls `handle_*` with instants that never decrease, then `poll` until it returns None,
then sets a timer to `poll_timeout`.
"""

from collections import OrderedDict, deque
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.mavlink.commands import (
    IN_PROGRESS,
    SET_MESSAGE_INTERVAL,
    Answer,
    answer_of_code,
    command_for_autopilot,
    command_id,
    message_interval,
)
from zacoustic.mavlink.composing import SOURCES, Composer
from zacoustic.mavlink.dialect import AUTOPILOT, Message, Received
from zacoustic.mavlink.entries import SERVICES, TELEMETRY, TEXT_BYTES
from zacoustic.mavlink.outputs import Notice, Output, Publish, Reply, Send
from zacoustic.mavlink.telemetry import HIGH_LATENCY2, HIGH_LATENCY2_ID, heartbeat, value_of

GROUND_COMPONENT: Final = 190
"""Component id of a ground station (MAV_COMP_ID_MISSIONPLANNER)."""

HEARTBEAT_NS: Final = seconds_to_ns(1.0)
"""Period of the HEARTBEAT, as MAVLink recommends it."""
SILENCE_NS: Final = seconds_to_ns(5.0)
"""The autopilot is lost after this time without its HEARTBEAT: five of them."""
RETRY_NS: Final = seconds_to_ns(1.5)
"""Time for an acknowledgement of an autopilot, which is on a cable."""
TRIES: Final = 5
"""How often a command is sent without an acknowledgement."""
PROGRESS_NS: Final = seconds_to_ns(20.0)
"""Time from an acknowledgement "in progress" to the next one or the last one."""
LATE_NS: Final = seconds_to_ns(120.0)
"""A command is on its way at most this long: twice the time-out of its service."""
_MISSED: Final = 3
# Senders, and runs of each, whose last order is known; of each a ground station needs one.
_RUNS: Final = 64

_INVALID_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID
_GROUND_STATION: Final = 6  # MAV_TYPE_GCS
_WARNING: Final = 4  # MAV_SEVERITY_WARNING


class _Command:
    """A command for the autopilot, until it ends."""

    def __init__(self, number: int, service: str, value: dict[str, Any], message: Message) -> None:
        self.number = number
        self.service = service
        self.value = value
        self.id = command_id(message)
        self.tries = 0
        self.due_at = 0
        self.is_acknowledged = False
        self.text = ""


class AutopilotSide:
    """Executes commands at the autopilot and publishes its HIGH_LATENCY2.

    Args:
        interval_s: Time between two samples, s.
        lost_after_s: Silence of the shore after which its HEARTBEATs end, s.
        system: System id of the autopilot; None: the first one that is heard.
        ground_system: System id under which this bridge speaks to the autopilot.
        now: The instant.
    """

    def __init__(
        self,
        *,
        interval_s: float,
        lost_after_s: float,
        system: int | None = None,
        ground_system: int = 255,
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
        self._commands: dict[int, deque[_Command]] = {}
        self._orders: OrderedDict[tuple[int, int], int] = OrderedDict()
        self._newest_run: dict[int, tuple[int, int]] = {}
        self._outputs: deque[Output] = deque()

    # Inputs

    def handle_message(self, received: Received, now: int) -> None:
        """Take a message from the autopilot's side."""
        if received.component != AUTOPILOT:
            return
        message = received.message
        if message.name == "HEARTBEAT":
            self._hear(received, now)
        if received.system != self._system or self._heartbeat is None:
            return
        if self._composer is not None:
            self._composer.take(message, now)
        if message.name == HIGH_LATENCY2:
            self._take_telemetry(message, now)
        elif message.name == "COMMAND_ACK":
            self._take_acknowledgement(message, now)
        elif message.name == "STATUSTEXT":
            self._take_text(message)

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
        is_shore: bool = False,
    ) -> None:
        """Execute a command; its answer is a `Reply`.

        Args:
            number: Names the call, ≥ 0.
            service: One of `entries.SERVICES`.
            value: The request.
            client: Acoustic address of the caller; None: on the vehicle.
            now: The instant.
            is_shore: Whether the caller is on shore, so that its call is a sign of life.
        """
        assert service in SERVICES
        self._say("command", f"{service}: {_told(value)}")
        if is_shore:
            self.handle_ground(now)
        is_in_order = self._is_in_order(client or 0, value.get("order"), now)
        # An abort is never too old: whatever came after it, somebody wanted the vehicle back.
        if not is_in_order and service != "abort":
            self._reply(number, service, Answer("superseded", "a later command came first"))
        elif not self._hears_autopilot(now):
            self._reply(number, service, Answer("no_autopilot", "no heartbeat of the autopilot"))
        else:
            self._begin(number, service, value, now)

    def handle_timeout(self, now: int) -> None:
        """Do what is due."""
        self._check_silence(now)
        self._check_ground(now)
        for queue in [*self._commands.values()]:
            if queue[0].due_at <= now:
                self._try_again(queue[0], now)
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
        due = [queue[0].due_at for queue in self._commands.values()]
        if self._beat_at is not None:
            due.append(self._beat_at)
        if self._heartbeat_at is not None:
            due.append(self._heartbeat_at + SILENCE_NS)
        others = (self._patient_until, self._compose_at, self._missing_at())
        due += [at for at in others if at is not None]
        return min(due, default=None)

    # The autopilot

    def _hear(self, received: Received, now: int) -> None:
        fields = received.message.fields
        is_autopilot = (
            fields["autopilot"] != _INVALID_AUTOPILOT and fields["type"] != _GROUND_STATION
        )
        wanted = self._wanted_system or self._system or received.system
        if not is_autopilot or received.system != wanted:
            return
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
        value = value_of(message, self._heartbeat, self._system)
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

    def _is_in_order(self, client: int, order: int | None, now: int) -> bool:
        """Return whether no later command of this client was executed; note this one.

        The upper half of an order is the run of the shore bridge, drawn at random; the lower half
        counts. So a bridge that has restarted is not taken for an old one, and what is still on
        its way from before that is refused, for as long as it may be. After that, two bridges at
        once can both give commands.
        """
        if order is None:
            return True
        run, count = order >> 16, order & 0xFFFF
        last = self._orders.get((client, run))
        if last is None:
            self._newest_run[client] = (run, now)
        newest, since = self._newest_run.get(client, (run, now))
        if (newest != run and now - since < LATE_NS) or (last is not None and count <= last):
            return False
        self._orders[client, run] = count
        self._orders.move_to_end((client, run))
        if len(self._orders) > _RUNS:
            self._orders.popitem(last=False)
        return True

    def _begin(self, number: int, service: str, value: dict[str, Any], now: int) -> None:
        command = _Command(number, service, value, self._message(service, value, 0))
        queue = self._commands.setdefault(command.id, deque())
        queue.append(command)
        if queue[0] is command:
            self._try_again(command, now)

    def _message(self, service: str, value: dict[str, Any], confirmation: int) -> Message:
        assert self._system is not None
        assert self._heartbeat is not None
        return command_for_autopilot(
            service,
            value,
            system=self._system,
            autopilot=self._heartbeat.fields["autopilot"],
            confirmation=confirmation,
        )

    def _try_again(self, command: _Command, now: int) -> None:
        if command.is_acknowledged or command.tries == TRIES:
            text = command.text or "the autopilot does not answer; it may have done it"
            self._end(command, Answer("no_answer", text), now)
            return
        self._send(self._message(command.service, command.value, command.tries))
        command.tries += 1
        command.due_at = now + RETRY_NS

    def _take_acknowledgement(self, message: Message, now: int) -> None:
        fields = message.fields
        if fields.get("target_system", 0) not in (0, self._ground_system):
            return  # of another ground station
        is_refused = fields["result"] not in (0, IN_PROGRESS)
        if fields["command"] == SET_MESSAGE_INTERVAL and is_refused and self._composer is None:
            # It does not say of which message: the first refusal is of HIGH_LATENCY2.
            self._begin_to_compose(answer_of_code(fields["result"]).result, now)
        queue = self._commands.get(fields["command"])
        if queue is None:
            return
        if fields["result"] == IN_PROGRESS:
            queue[0].is_acknowledged = True
            queue[0].due_at = now + PROGRESS_NS
            return
        text = "" if fields["result"] == 0 else queue[0].text
        self._end(queue[0], answer_of_code(fields["result"], text), now)

    def _complain(self, text: str) -> None:
        """Say once that there is no telemetry; again after some has come."""
        if not self._complained:
            self._complained = True
            self._say("no_telemetry", text, is_trouble=True)

    def _take_text(self, message: Message) -> None:
        """Keep why the autopilot refuses a command: it says that just before it does."""
        fields = message.fields
        if fields["severity"] <= _WARNING and not fields.get("chunk_seq"):
            for queue in self._commands.values():
                queue[0].text = str(fields["text"])

    def _end(self, command: _Command, answer: Answer, now: int) -> None:
        queue = self._commands[command.id]
        queue.popleft()
        self._reply(command.number, command.service, answer)
        if queue:
            self._try_again(queue[0], now)
        else:
            del self._commands[command.id]

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
    shown = {name: each for name, each in value.items() if each is not None and name != "order"}
    return msgspec.json.encode(shown).decode()
