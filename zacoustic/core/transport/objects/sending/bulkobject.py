"""The sender's side of a transfer to one node by the bulk service of its link.

The device acknowledges each fragment. So the sender knows which ones are lost and sends exactly
those again; it asks the receiver only at the end of a block, what no device knows: whether the
other *node* has all of it. Several fragments are under way at a time, as many as the port takes.
What the receiver still lacks then (its computer was restarted, say) goes as repair fragments, of
which any will do. Whoever does not answer that, although its device has all of it, is asked by
short records of the plain service, since its computer may be off. One that has started anew knows
nothing of the transfer and does not answer those, so a fragment asks when the node is back, and now
and then.

A half-duplex modem that sends train after train hears nobody. So a run of fragments ends with one
that announces a pause (`ListenHint.WINDOW`), and none follows before all are reported and the pause
is over. How long runs are is for `BulkRuns` to say: there is no fixed share of silence.

If everything under way was lost, the receiver or the connection is not there. Then the sender
pauses as its pacer says, and sends what was lost again.
"""

import random
from collections import Counter
from typing import Final

from zacoustic.core.base.linktypes import TransmitOutcome, TransmitReport
from zacoustic.core.transport.objects.code.code import Fragments
from zacoustic.core.transport.objects.manifest import Manifest
from zacoustic.core.transport.objects.sending.outgoing import OutgoingObject
from zacoustic.core.transport.objects.sending.planning import LossEstimate
from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.wire.objects import CHECK_BYTES, Feedback, Fragment, ListenHint

_FEW_LEFT: Final = 8
_MOST_CUTS: Final = 5
_FULL_QUESTION: Final = 6
"""Of so many questions in a row one is a fragment."""


class BulkObject(OutgoingObject):
    """One object under way by a bulk service; for the arguments see `OutgoingObject`."""

    is_bulk = True

    def __init__(
        self,
        transfer: int,
        receivers: dict[int, LossEstimate],
        manifest: Manifest,
        fragments: Fragments,
        rng: random.Random,
    ) -> None:
        super().__init__(transfer, receivers, manifest, fragments, rng)
        self.ends_run = False
        """Whether its last fragment has announced a pause that has not begun."""
        self._asks = False
        """Whether a request is under way."""
        self._under_way: Counter[int] = Counter()
        self._lost: list[int] = []
        self._arrived: Counter[int] = Counter()
        """Fragments of each block that arrived since the receiver's last feedback."""
        self._sources_arrived: set[int] = set()
        self._cuts = 0
        """How often in a row all that was under way was cut short."""
        self._is_back = False
        """Whether the receiver was heard again, and no fragment has gone since."""
        self._any_arrived = False
        """Whether any of those that went since nothing was under way has arrived."""

    @property
    def needs_bulk(self) -> bool:
        """Whether its next record is a fragment; others are small and go by the plain service."""
        return not self.is_withdrawn and bool(self._lacking()) and not self._only_asks

    @property
    def fragment_bytes(self) -> int:
        """Bytes of data in the next record."""
        return CHECK_BYTES if self._only_asks else super().fragment_bytes

    @property
    def bulk_at(self) -> int | None:
        """Instant from which a fragment may go, ns; None: a report must come first."""
        waits = self.listens or self.ends_run
        return None if waits and self._under_way else self.due_at

    @property
    def is_unheard(self) -> bool:
        """Never: its device tells whether the receiver is there, and what is in vain is paced."""
        return False

    @property
    def receiver(self) -> int:
        """Address of its receiver."""
        return next(iter(self.views))

    @property
    def done_bytes(self) -> int:
        """Bytes of the payload that the receiver, or its device, is known to have."""
        arrived_bytes = len(self._sources_arrived) * self.fragments.layout.fragment_bytes
        return min(self.manifest.payload_bytes, max(super().done_bytes, arrived_bytes))

    def take(
        self, timing: Timing, *, window_follows: bool, is_present: bool, is_silent: bool
    ) -> Fragment:
        """Take the next record for the plain service; see `OutgoingObject.take`."""
        if self._only_asks:
            return self.take_turn(self.receiver)
        return super().take(
            timing, window_follows=window_follows, is_present=is_present, is_silent=is_silent
        )

    def release(self, address: int, now: int) -> None:
        """Make due what waits for a receiver that is back."""
        super().release(address, now)
        self._is_back = True
        self._cuts = 0

    def cut_short(self) -> int:
        """Record that the device has dropped all that was under way; return how often it had."""
        before, self._cuts = self._cuts, min(self._cuts + 1, _MOST_CUTS)
        return before

    def take_bulk(self, *, pause_follows: bool) -> Fragment:
        """Take the next fragment for transmission.

        Args:
            pause_follows: This node has sent for so long that it should listen.
        """
        self._is_back = False
        self._asked = self._lacking()
        if not self._round:
            self._round.extend(self._plan_bulk())
        index = self._round.popleft()
        call = ListenHint.ANSWER
        if self._round:
            # Not just before the round ends: then this node listens anyway.
            is_worth_it = pause_follows and len(self._round) >= _FEW_LEFT
            call = ListenHint.WINDOW if is_worth_it else ListenHint.NONE
        self.ends_run = call is ListenHint.WINDOW
        self._asks = call is ListenHint.ANSWER
        self._under_way[index] += 1
        fragment = self._mark(index, call)
        self.is_asking = False  # `bulk_at` waits for its report
        return fragment

    def reported(self, index: int, report: TransmitReport, timing: Timing, silence_ns: int) -> bool:
        """Record the report of a fragment; return whether all that was under way was lost.

        Args:
            index: The fragment.
            report: Its report.
            timing: The durations.
            silence_ns: Least pause after a request that the receiver does not answer, ns.
        """
        self._under_way -= Counter([index])
        has_asked = self._asks and not self._under_way
        self._asks = self._asks and not has_asked
        if report.outcome in (TransmitOutcome.DELIVERED, TransmitOutcome.SENT):
            self._any_arrived = True
            self._cuts = 0
            layout = self.fragments.layout
            self._arrived[layout.block_of(index)] += 1
            if index < layout.fragments:
                self._sources_arrived.add(index)
            if has_asked:
                self.transmitted_until(report.finished_at, timing, silence_ns)
        else:
            self._lost.append(index)
            if has_asked:  # nobody will answer
                self.listens = False
                self.due_at = report.finished_at
        if self._under_way or self.is_withdrawn:
            return False
        if self.ends_run:
            self.due_at = report.finished_at
        is_in_vain = not self._any_arrived
        self._any_arrived = False
        return is_in_vain

    def pause_until(self, instant: int) -> None:
        """Send no fragment before an instant, ns; the announced pause, if any, is that."""
        self.ends_run = False
        self.due_at = max(self.due_at, instant)

    def answered(self, source: int, feedback: Feedback, now: int) -> bool:
        """Take a feedback; return False when it is not new or not about this object."""
        view = self.views.get(source)
        if view is not None and view.asked is None and self._asks:
            view.asked = dict(view.sent)  # the answer is here before the report of the request
        is_new = super().answered(source, feedback, now)
        if is_new:
            self._asks = False
            self._cuts = 0
            self._arrived.clear()
            self._lost.clear()  # the receiver counts them as lacking
        return is_new

    # Below the methods above

    @property
    def _only_asks(self) -> bool:
        """Whether its device has all of it, and the receiver has not answered what asked it."""
        if self.is_withdrawn or self._round or self._under_way or self._lost:
            return False
        view = self.views[self.receiver]
        layout = self.fragments.layout
        is_sent = self.next_source == layout.fragments or None in view.lacking.values()
        asks_fully = self._is_back or view.unanswered % _FULL_QUESTION == 0
        if view.headless or asks_fully or not is_sent:
            return False
        return all(
            lacking is None or lacking <= self._arrived[block]
            for block, lacking in view.lacking.items()
        )

    def _plan_bulk(self) -> list[int]:
        """Return the indices of the next round; never empty."""
        layout = self.fragments.layout
        planned = sorted(set(self._lost))
        self._lost.clear()
        view = next(iter(self.views.values()))
        if view.headless:
            planned += [index for index in self._head() if index not in planned]
        unknown = None in view.lacking.values()
        for block, lacking in sorted(view.lacking.items()):
            if lacking is None or layout.first(block + 1) > self.next_source:
                continue
            waiting = sum(layout.block_of(index) == block for index in planned)
            planned += self._repairs(block, lacking - self._arrived[block] - waiting)
        if self.next_source < layout.fragments and not unknown:
            block = layout.block_of(self.next_source)
            planned += range(self.next_source, layout.first(block + 1))
        if planned:
            return planned
        # It has everything, or is to say what it has: one fragment asks.
        behind = self._behind(self._lacking()) or [layout.blocks - 1]
        return self._repairs(behind[-1], 1)
