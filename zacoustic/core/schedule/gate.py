"""The gate: the one place that decides whether a frame may go now, and why it waits.

A *reason* is a function of a frame, an instant, and now: it returns the earliest instant that it
allows, not before the given one, or None if no instant is known, because an input must come first.
Reasons are pure: to ask changes nothing. Each lives in its own room, and the gate only knows their
order. Each kind of frame has a *passage*, which is a list of reasons::

                    door: now or not       reasons: each may move the instant forward
  records           modem, journal         airtime, gap, burst, pause, access, silence
  last word         modem                  gap, burst, pause, access
  granted           modem                  gap, burst, pause, access
  access's own      modem                  gap, silence
  burst             window, journal        airtime, silence
  ride back         journal                silence, airtime

The *last word* answers a command to be silent, and a *granted* frame is one of another link, such
as a bond, with a last word in it; both go during a silence. Frames that the device *rides back*
with what it says to a node need no access of their own.

One walk along a list decides. An instant ahead of now is a prediction: the engine asks again when
it has come, until no reason moves it. `Gate.waits` walks ahead in this way on its own, and names
the reason that moved the instant last. It is for those who look on, and nothing depends on it.
"""

from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.waits import Waits, Why
from zacoustic.core.schedule.access.base import Wanted
from zacoustic.core.schedule.airtime import AirtimeCaps
from zacoustic.core.schedule.frames import Frames
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import LaneKey
from zacoustic.core.schedule.silence import Silence

_MOST_WALKS: Final = 16
"""`Gate.waits` looks ahead this often at most; then the instant is not known."""

Allows: TypeAlias = Callable[[Wanted, int, int], int | None]
"""``(wanted, at, now)``: the earliest instant not before `at`, ns; None: unknown."""


class WaitReason:
    """A reason for which a frame may wait.

    Args:
        allows: Returns the earliest instant that it allows.
        why: Its word, or returns that for the same arguments.
        holds: Called with a frame, and now, when it waits for this reason and for none before it;
            None: nobody wants to know.
    """

    __slots__ = ("allows", "holds", "why")

    def __init__(
        self,
        allows: Allows,
        why: Why | Callable[[Wanted, int, int], Why],
        holds: Callable[[Wanted, int], None] | None = None,
    ) -> None:
        self.allows = allows
        self.why = why
        self.holds = holds


class Passage:
    """The way of one kind of frame through the gate.

    Args:
        reasons: The reasons, in their order.
    """

    __slots__ = ("_reasons",)

    def __init__(self, reasons: Sequence[WaitReason]) -> None:
        self._reasons = tuple(reasons)

    def opens(self, wanted: Wanted, now: int, *, holds: bool = False) -> bool:
        """Return whether a frame may go now.

        Args:
            wanted: The frame.
            now: The instant.
            holds: It goes if it may; otherwise tell the reason that holds it.
        """
        at = wanted.due_at
        if at > now:
            return False
        for each in self._reasons:
            allowed = each.allows(wanted, at, now)
            if allowed is None or allowed > now:
                if holds and each.holds is not None:
                    each.holds(wanted, now)
                return False
            at = allowed
        return True

    def next_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the instant that all reasons allow, each from that of the one before, ns."""
        at = wanted.due_at
        for each in self._reasons:
            allowed = each.allows(wanted, at, now)
            if allowed is None:
                return None
            at = allowed
        return at

    def last_mover(self, wanted: Wanted, now: int) -> tuple[int | None, Why | None]:
        """Return the same, and the word of the reason that moved it last beyond now, if any."""
        at, last = wanted.due_at, None
        for each in self._reasons:
            allowed = each.allows(wanted, at, now)
            if allowed is None or allowed > max(at, now):
                last = each.why if isinstance(each.why, Why) else each.why(wanted, at, now)
            if allowed is None:
                return None, last
            at = allowed
        return at, last


class Gate:
    """Decides for one link when each kind of frame may go.

    Args:
        port: The port of the link.
        frames: What waits.
        silence: The transmit silence.
        airtime: The airtime caps.
        is_up: Whether the link is up.
    """

    def __init__(
        self,
        port: LinkPort,
        frames: Frames,
        silence: Silence,
        airtime: AirtimeCaps,
        *,
        is_up: bool,
    ) -> None:
        self.is_up = is_up
        """Whether the link is up; written when its state changes."""
        self.rides_back = port.rides_back
        """Whether frames may ride back at all."""
        self.speaks = port.access.speaks
        """Whether medium access may get frames of its own."""
        self.has_bulk = port.bulk is not None
        """Whether there is a bulk service."""
        self._port = port
        self._frames = frames
        self._silence = silence
        gap = WaitReason(port.after_gap, Why.MODEM)
        medium = [gap]
        if port.capabilities.bulk is not None:
            medium.append(WaitReason(port.after_burst, Why.BURST))
        if port.capabilities.half_duplex:
            medium.append(WaitReason(port.after_pause, Why.PAUSE))
        medium.append(
            WaitReason(port.by_access, port.why_not_by_access, port.access.handle_waiting)
        )
        silent = WaitReason(silence.after_silence, Why.SILENCE)
        spent = WaitReason(airtime.after_debt, Why.AIRTIME)
        self._records = Passage([spent, *medium, silent])
        self._in_silence = Passage(medium)
        self._of_access = Passage([gap, silent])
        self._of_bulk = Passage([spent, silent])
        self._back = Passage([silent, spent])

    # Whether a frame goes now. The reason that holds it learns of it.

    def opens(self, now: int) -> bool:
        """Return whether a frame of waiting records goes."""
        if not self.is_up or self._why_shut(now) is not None:
            return False
        self._frames.queue.settle(now)
        due_at = self._frames.due_at(now)
        if due_at is None or due_at > now:
            return False
        return self._records.opens(self._wanted(due_at, now), now, holds=True)

    def opens_to_last_word(self, lane: LaneKey, now: int) -> bool:
        """Return whether the frame goes that a silence grants to a lane."""
        self._frames.queue.settle(now, lane)
        wanted = self._last_word_due(lane, now)
        return wanted is not None and self._in_silence.opens(wanted, now, holds=True)

    def opens_to_granted(self, now: int) -> bool:
        """Return whether a frame of another link goes that may go in silence."""
        wanted = self._granted_due(now) if self._frames.forwarding is not None else None
        return wanted is not None and self._in_silence.opens(wanted, now, holds=True)

    def opens_to_access(self, now: int) -> bool:
        """Return whether medium access gets a frame of its own."""
        wanted = self._access_due(now)
        return wanted is not None and self._of_access.opens(wanted, now)

    def opens_to_bulk(self, now: int) -> bool:
        """Return whether a frame of the bulk service goes."""
        wanted = self._bulk_due(now)
        return wanted is not None and self._of_bulk.opens(wanted, now)

    def rides_back_to(self, now: int) -> int | None:
        """Return the node to which a frame rides back that is given now; None: to none."""
        is_urgent = self._frames.is_urgent(now)
        address = self._port.rides_back_to(now, is_urgent=is_urgent)
        if address is None or not self.is_up or not self._frames.epoch.may_speak:
            return None
        self._frames.queue.settle(now)
        due_at = self._frames.due_at(now)
        if due_at is None or not self._back.opens(Wanted(due_at, is_urgent), now):
            return None
        return address

    # Getters

    def is_free(self, now: int, *, holds: bool = False) -> bool:
        """Return whether a record that was queued now could go at once.

        Args:
            now: The instant.
            holds: There is one; tell the reason that holds it.
        """
        if not self.is_up or self._why_shut(now) is not None:
            return False
        return self._records.opens(self._wanted(now, now), now, holds=holds)

    def is_due(self, now: int) -> bool:
        """Return whether a frame of waiting records may go now."""
        wanted = self._records_due(now)
        return wanted is not None and self._records.opens(wanted, now)

    def next_at(self, now: int) -> int | None:
        """Return the instant from which a frame can and should go, ns, or None.

        It may be too early, never too late.
        """
        lane = self._silence.granted(now)
        if lane is not None:
            wanted = self._last_word_due(lane, now)
            return None if wanted is None else self._in_silence.next_at(wanted, now)
        if self._has_granted and self._silence.is_silent(now):
            wanted = self._granted_due(now)
            return None if wanted is None else self._in_silence.next_at(wanted, now)
        ways = [(self._records_due(now), self._records)]
        if self.speaks:
            ways.append((self._access_due(now), self._of_access))
        if self.has_bulk:
            ways.append((self._bulk_due(now), self._of_bulk))
        earliest: int | None = None
        for wanted, passage in ways:
            at = None if wanted is None else passage.next_at(wanted, now)
            if at is not None and (earliest is None or at < earliest):
                earliest = at
        return earliest

    def waits(self, now: int) -> Waits | None:
        """Return why the next frame waits; None: nothing waits, or it goes at once."""
        why: Why | None = None
        due_at = self._frames.due_at(now)
        if due_at is None or due_at > now:
            held = self._frames.held(now)
            if held is None:
                return None
            due_at, why = held
        shut = self._why_shut(now) if self.is_up else Why.LINK
        if shut is not None and (shut is not Why.MODEM or due_at <= now):
            return Waits(why=shut, until=None)
        at: int | None = max(due_at, now)
        for _ in range(_MOST_WALKS):
            assert at is not None
            then = at
            at, mover = self._records.last_mover(self._wanted(due_at, then), then)
            why = mover or why
            if at is None:
                break
            if at <= then:
                at = then
                break
        else:
            at = None
        return None if why is None else Waits(why=why, until=at)

    # Below the methods above

    def _records_due(self, now: int) -> Wanted | None:
        """Return the frame of records that is due next; None: none is, or the gate is shut."""
        if not self.is_up or self._why_shut(now) is not None:
            return None
        due_at = self._frames.due_at(now)
        return None if due_at is None else self._wanted(due_at, now)

    def _last_word_due(self, lane: LaneKey, now: int) -> Wanted | None:
        if not self.is_up or not self._takes_urgent:
            return None
        due_at = self._frames.queue.due_at(now, lane)
        return None if due_at is None else Wanted(due_at, is_urgent=True)

    def _granted_due(self, now: int) -> Wanted | None:
        if not self._has_granted or not self.is_up or not self._takes_urgent:
            return None
        return Wanted(now, is_urgent=True) if self._silence.is_silent(now) else None

    def _access_due(self, now: int) -> Wanted | None:
        if not self.is_up or self._port.is_full:
            return None
        at = self._port.access.speak_at(now)
        return None if at is None else Wanted(at)

    def _bulk_due(self, now: int) -> Wanted | None:
        if not self.is_up or not self._port.takes_bulk:
            return None
        due_at = self._frames.bulk_due_at(now) if self._frames.epoch.may_speak else None
        return None if due_at is None else Wanted(due_at)

    def _why_shut(self, now: int) -> Why | None:
        """Return why no record goes, whatever the instant; None: it may."""
        port = self._port
        if port.is_full and not (port.keeps_reserve and self._frames.is_urgent(now)):
            return Why.MODEM
        return None if self._frames.epoch.may_speak else Why.JOURNAL

    @property
    def _has_granted(self) -> bool:
        """Whether a frame of another link waits that may go although the node is silent."""
        forwarding = self._frames.forwarding
        return forwarding is not None and forwarding.has_granted

    @property
    def _takes_urgent(self) -> bool:
        return not self._port.is_full or self._port.keeps_reserve

    def _wanted(self, due_at: int, now: int) -> Wanted:
        """Return what waits, as it concerns the medium."""
        frames = self._frames
        forwarding = frames.forwarding
        wanted = Wanted(
            due_at,
            frames.is_urgent(now),
            is_copy=frames.queue.has_copy,
            is_in_train=forwarding is not None and forwarding.goes_on,
        )
        if address := self._port.bulk_source:
            # What concerns a node that sends this one much data.
            if wanted.is_urgent:
                wanted.rides_back = frames.rides_back(address, now)
            else:
                first = frames.queue.best(now)
                is_to_it = first is None or first.destination in (BROADCAST, address)
                wanted.is_for_others = not is_to_it
        return wanted
