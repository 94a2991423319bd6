"""The frames of the bulk service: as burst data in the modem's buffer, as many as it takes.

The first frame that the modem does not have yet is given as follows; the others wait behind it::

    IDLE ──► COUNTING ──AT?PC──► GIVING ──OK──► the modem has it; the next one
               ▲  ▲                │ │
               │  └──── PAUSING ◄──┘ └─no answer─► DOUBTING ─AT?PC─► it has it, or ABORTED
               └─ MENDING ◄─ buffers are not empty, out of context

`AT?PC` tells the number under which the modem will report the frame. A modem that is busy or has a
full buffer is asked again when it reports anything that may have made room, at the latest after a
pause; after `busy_s` in which it reports nothing at all the frame is rejected. A frame that the
modem may have is never given again.

While a message waits for the modem, no frames are given: some modems may send it when they have no
burst data any more. An urgent message does not wait behind burst data: the modem drops those
(`ATZ1`), they are reported ABORTED, and the next frames are given when the message has gone. A
train on the air ends first, and its receiver, which then acknowledges it, hears nothing for a
moment. They are dropped after that moment, or when the acknowledgement begins to arrive: without
burst data, a message that the modem has already would go at once, and nobody would hear it.

Having made way, they stay for a while or until one of theirs has arrived: urgent messages in a row
would leave nothing else. Until then the modem gets no more of them than go in one train, so that
the next urgent message waits for that one only; if it does not arrive in time, they make way again.

A modem that reports none of its frames for long may have been restarted. The driver asks it; it
also drops all of them after `BURST_LIMIT_S` without any report.
"""

import enum
from collections import deque
from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import Transmission, TransmitOutcome, TransmitReport
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at.commands import Act, Action, Query, SendBurst, Set
from zacoustic_evologics.at.fields import BURST_LIMIT_BYTES
from zacoustic_evologics.at.replies import Accepted, Number, Refused
from zacoustic_evologics.driver.channel import Answer, CommandChannel
from zacoustic_evologics.driver.sending.answers import in_words
from zacoustic_evologics.driver.sending.service import Remedy, remedy_command, remedy_for
from zacoustic_evologics.driver.sending.times import BURST_LIMIT_S, BUSY_PAUSE_S
from zacoustic_evologics.driver.sending.trains import Trains
from zacoustic_evologics.driver.session.session import MOST_OUTSTANDING, ModemSession

_STAY_S: Final = 12.0
"""After burst data have made way they stay for so long, s: about two trains."""
_STIRRING: Final = (said.Delivered, said.Failed, said.Status, said.RecvEnd, said.RecvFailed)
_DROP_BURSTS: Final = Act(Action.RESET, 1)


class _Step(enum.Enum):
    """What is being done for the first frame that the modem does not have."""

    IDLE = "idle"
    COUNTING = "counting"
    GIVING = "giving"
    DOUBTING = "doubting"
    MENDING = "mending"
    PAUSING = "pausing"


class _Burst:
    """One frame, and the instant from which it was given, ns."""

    def __init__(self, transmission: Transmission, now: int) -> None:
        self.transmission = transmission
        self.called_at = now
        self.given_at = now


class Bursts:
    """The frames of the bulk service that have not been reported.

    Args:
        channel: Takes commands.
        session: State of the modem.
    """

    def __init__(self, channel: CommandChannel, session: ModemSession) -> None:
        self.ticket: int | None = None
        """Ticket of the awaited answer's command."""
        self.due_at: int | None = None
        """When to call `handle_timeout`, ns."""
        self.must_check = False
        """Whether the modem should be asked if it was restarted; the caller clears it."""
        self._channel = channel
        self._session = session
        self._waiting: deque[_Burst] = deque()
        self._given: dict[tuple[int, int], _Burst] = {}
        self._step = _Step.IDLE
        self._counter = 0
        self._stirred_at = 0
        self._paused_until = 0
        self._early: said.Delivered | said.Failed | None = None
        self._refusal = ""
        self._has_cleared = False
        self._is_held = False
        self._makes_way = False
        self._way_from: int | None = None
        """From when on the modem is to drop them for an urgent message, ns; None: none waits."""
        self._stays_until = 0
        """They make way no more until then, ns, or until one of them has arrived."""
        self._is_staying = False
        """Whether that message came before that: it does not wait for the drop."""
        self._trains = Trains()
        self._cluster: int | None = None
        self._reports: list[TransmitReport] = []

    def __len__(self) -> int:
        return len(self._waiting) + len(self._given)

    def refuse(self, transmission: Transmission) -> str:
        """Return why a frame cannot be sent as burst data; empty: it can."""
        size, to, session = len(transmission.frame_bytes), transmission.destination, self._session
        if not session.has_bulk:
            return "burst data are switched off"
        if not 1 <= size <= BURST_LIMIT_BYTES:
            return f"frame of {size} bytes; allowed: 1..{BURST_LIMIT_BYTES}"
        if not 1 <= to <= session.highest_address or to == session.address:
            return (
                f"destination {to}; allowed: 1..{session.highest_address} except {session.address}"
            )
        if len(self) >= MOST_OUTSTANDING:
            return f"{MOST_OUTSTANDING} bursts are outstanding"
        return ""

    def transmit(self, transmission: Transmission, now: int) -> None:
        """Take a frame."""
        if not len(self):
            self._stirred_at = now
        self._waiting.append(_Burst(transmission, now))
        self._go_on(now)

    def hold(self) -> None:
        """Give the modem no more frames: a message waits that it may send last of all."""
        self._is_held = True

    @property
    def keeps_back(self) -> bool:
        """Whether the message that they make way for is not to be given to the modem yet."""
        return self._way_from is not None and not self._is_staying

    def make_way(self, now: int) -> None:
        """Let the modem drop the frames that it has, for a message that does not wait."""
        self.hold()
        if self._is_empty:
            return
        self._is_staying = now < self._stays_until
        self._way_from = max(now, self._stays_until)
        self._drop_if_due(self._trains.is_answered_at, now)
        self._arm(now)

    def go_on(self, now: int) -> None:
        """Give frames again: that message has gone."""
        if self._is_held:
            self._is_held = self._makes_way = False
            self._way_from = None
            self._go_on(now)

    def handle_answer(self, answer: Answer, now: int) -> None:
        """Take the answer to the command of `ticket`."""
        self.ticket = None
        reply = answer.reply
        match self._step:
            case _Step.COUNTING if isinstance(reply, Number):
                self._counter = reply.value
                self._ask_to_give(now)
            case _Step.COUNTING | _Step.MENDING:
                self._refusal = in_words(reply) if reply is not None else "no answer"
                if self._step is _Step.MENDING and reply is not None:
                    self._step = _Step.IDLE
                    self._go_on(now)
                else:
                    self._pause(now)
            case _Step.GIVING if isinstance(reply, Accepted):
                self._has_it(now)
            case _Step.GIVING if isinstance(reply, Refused):
                self._refused(reply, now)
            case _Step.GIVING:
                self._doubt(now)
            case _Step.DOUBTING if isinstance(reply, Number) and reply.value != self._counter:
                self._has_it(now)
            case _Step.DOUBTING:
                text = in_words(reply) if reply is not None else "no answer"
                self._end_first(TransmitOutcome.ABORTED, f"no answer; then AT?PC: {text}", now)
            case _:
                pass
        self._arm(now)

    def handle_notification(self, record: said.Notification, now: int) -> None:
        """Take a message of the modem; most are about other matters."""
        if isinstance(record, said.Delivered | said.Failed):
            self._end_given(record, now)
        elif isinstance(record, said.SendStart):
            receivers = {to for _, to in self._given}
            is_to_receiver = record.destination in receivers
            self._trains.begins(record, now, is_to_receiver=is_to_receiver)
            self._limit_trains(now)
        elif isinstance(record, said.RecvStart):
            self._drop_if_due(self._trains.sounds_until, now)  # else the next train would follow
        elif isinstance(record, said.BitRate) and record.direction is said.Direction.LOCAL:
            self._trains.use_rate(record.bit_rate_bps)
            self._limit_trains(now)
        if isinstance(record, _STIRRING) and len(self):
            self._stirred_at = now
            if self._step is _Step.PAUSING:
                self._step = _Step.IDLE
                self._go_on(now)
        self._go_on(now)

    def handle_timeout(self, now: int) -> None:
        """Handle the end of a pause, and the modem's silence."""
        if self.due_at is None or now < self.due_at:
            return
        self._drop_if_due(self._trains.is_answered_at, now)
        silent_ns = now - self._stirred_at
        if self._given and silent_ns >= seconds_to_ns(BURST_LIMIT_S):
            self._channel.ask(_DROP_BURSTS, now)
            self._abort_given("the modem says nothing of its end; dropped", now)
            self.must_check = True
            self._stirred_at = now
        elif self._step is _Step.PAUSING:
            self._step = _Step.IDLE
            busy_ns = seconds_to_ns(self._session.config.busy_s)
            if not self._given and silent_ns >= busy_ns:
                waited = f"{self._refusal}, {self._session.config.busy_s:g} s long"
                self._stirred_at = now
                self._end_first(TransmitOutcome.REJECTED, waited, now)
        self._go_on(now)

    def handle_lost(self, reason: str, now: int) -> None:
        """Handle the loss of the connection or the modem: report everything."""
        self._abort_given(reason, now)
        while self._waiting:
            self._report(self._waiting.popleft(), TransmitOutcome.ABORTED, reason, now)
        self._step = _Step.IDLE
        self._is_held = self._makes_way = False
        self._cluster = self.ticket = self.due_at = self._way_from = None

    def poll_report(self) -> TransmitReport | None:
        """Return the next report."""
        return self._reports.pop(0) if self._reports else None

    # Below the methods above

    def _go_on(self, now: int) -> None:
        if self._step is _Step.IDLE and self._waiting and not self._is_held and self._has_room(now):
            self._step = _Step.COUNTING
            self.ticket = self._channel.ask(Query("PC"), now)
        self._arm(now)

    @property
    def _is_empty(self) -> bool:
        """Whether the modem has none."""
        return not self._given and self._step is not _Step.GIVING

    def _has_room(self, now: int) -> bool:
        """Return whether the modem may have one more: just one train after they have made way."""
        return now >= self._stays_until or len(self._given) < (self._cluster or 1)

    def _drop_if_due(self, heard_from: int, now: int) -> None:
        """Let the modem drop what it has for an urgent message that waits.

        Args:
            heard_from: When the receiver of the last train hears again, ns.
            now: The instant.
        """
        if self._way_from is None or now < max(self._way_from, heard_from):
            return
        self._way_from = None
        if self._is_empty:
            return
        self._makes_way = True
        self._stays_until = now + seconds_to_ns(_STAY_S)
        self._trains.is_dropped()
        self._channel.ask(_DROP_BURSTS, now)

    def _limit_trains(self, now: int) -> None:
        """Ask for trains of as many packets as they should have."""
        cluster = self._trains.packets
        if len(self) and cluster is not None and cluster != self._cluster:
            self._cluster = cluster
            self._channel.ask(Set("ZC", cluster), now)

    def _ask_to_give(self, now: int) -> None:
        self._step, self._early = _Step.GIVING, None
        burst = self._waiting[0]
        burst.given_at = now
        made = burst.transmission
        command = SendBurst(payload=made.frame_bytes, destination=made.destination)
        self.ticket = self._channel.ask(command, now)

    def _has_it(self, now: int) -> None:
        burst = self._waiting.popleft()
        older = self._given.pop((self._counter, burst.transmission.destination), None)
        if older is not None:  # the modem's counter has wrapped, or it was restarted
            self._report(older, TransmitOutcome.ABORTED, "the modem has never reported it", now)
        self._given[self._counter, burst.transmission.destination] = burst
        self._has_cleared = False
        self._step = _Step.IDLE
        early, self._early = self._early, None
        if early is not None:
            self._end_given(early, now)
        self._go_on(now)

    def _refused(self, reply: Refused, now: int) -> None:
        self._refusal = in_words(reply)
        remedy = remedy_for(reply)
        if remedy is Remedy.ASK:
            self._doubt(now)
        elif remedy is Remedy.NONE:
            self._end_first(TransmitOutcome.REJECTED, self._refusal, now)
        elif remedy is Remedy.WAIT or self._given or self._has_cleared:
            self._pause(now)  # what is in the buffer is ours: it will go
        else:
            self._has_cleared = True
            self._step = _Step.MENDING
            self.ticket = self._channel.ask(remedy_command(remedy), now)

    def _doubt(self, now: int) -> None:
        self._step = _Step.DOUBTING
        self.ticket = self._channel.ask(Query("PC"), now)

    def _pause(self, now: int) -> None:
        self._step = _Step.PAUSING
        self._paused_until = now + seconds_to_ns(self._session.rng.uniform(*BUSY_PAUSE_S))

    def _arm(self, now: int) -> None:
        instants = []
        if self._step is _Step.PAUSING:
            instants.append(self._paused_until)
        if self._given:
            instants.append(self._stirred_at + seconds_to_ns(BURST_LIMIT_S))
        if self._way_from is not None:
            instants.append(max(self._way_from, self._trains.is_answered_at))
        if self._waiting and not self._is_held and not self._has_room(now):
            instants.append(self._stays_until)
        self.due_at = min(instants, default=None)
        self._session.note_own_bursts(has_bursts=bool(self._given), now=now)

    def _end_given(self, record: said.Delivered | said.Failed, now: int) -> None:
        key = (record.counter, record.destination)
        burst = self._given.pop(key, None)
        if burst is None and self._step in (_Step.GIVING, _Step.DOUBTING) and self._waiting:
            # The answer was lost, or is later than the report.
            first = self._waiting[0]
            if (self._counter, first.transmission.destination) == key:
                self._early = record
                return
        if burst is None:
            return
        is_there = isinstance(record, said.Delivered)
        if is_there:
            self._trains.is_delivered()
            self._stays_until = 0
            self._way_from = None if self._way_from is None or self._is_empty else now
        if self._makes_way and not is_there:
            self._report(burst, TransmitOutcome.ABORTED, "it made way for a message", now)
            return
        outcome = TransmitOutcome.DELIVERED if is_there else TransmitOutcome.NOT_DELIVERED
        self._report(burst, outcome, "", now)

    def _end_first(self, outcome: TransmitOutcome, detail: str, now: int) -> None:
        self._report(self._waiting.popleft(), outcome, detail, now)
        self._step = _Step.IDLE
        self._go_on(now)

    def _abort_given(self, reason: str, now: int) -> None:
        given, self._given = self._given, {}
        for burst in given.values():
            self._report(burst, TransmitOutcome.ABORTED, reason, now)
        self._session.note_own_bursts(has_bursts=False, now=now)

    def _report(self, burst: _Burst, outcome: TransmitOutcome, detail: str, now: int) -> None:
        self._reports.append(
            TransmitReport(
                transmission_id=burst.transmission.transmission_id,
                outcome=outcome,
                started_at=min(now, burst.given_at),
                finished_at=now,
                detail=detail,
            )
        )
