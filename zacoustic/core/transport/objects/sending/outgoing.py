"""The sender's side of one transfer: rounds of fragments, each ending with a request for feedback.

A *round* is the source fragments of the next block, and as many repair fragments of the blocks
before as the receivers will probably need. Its last fragment requests feedback, and the one before
announces that, so that a receiver answers when either has arrived. Then the sender listens. For
each receiver it knows how many fragments of each block that receiver lacks; it never knows which,
and need not.

Until a receiver has answered it may not be there, so the first round is short. Without an answer
the next one is short too, and useful: repair fragments, since a loss is the likeliest reason. After
several requests in a row without an answer single fragments follow, when the receivers' pacers
allow it (`zacoustic.core.schedule.pacers`).

A receiver that has all of it may have to wait for earlier samples. The sender sends it nothing
until none of them will come; then it sends the receiver its turn.
"""

import random
from collections import deque
from collections.abc import Callable, Iterator, Set
from typing import Final

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.transport.objects.code.code import BLOCK_FRAGMENTS, Fragments
from zacoustic.core.transport.objects.manifest import Manifest
from zacoustic.core.transport.objects.sending.planning import LossEstimate, repairs_to_send
from zacoustic.core.transport.objects.sending.receiverview import ReceiverView
from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.wire.objects import (
    CHECK_BYTES,
    MOST_BLOCKS,
    NO_FRAGMENT,
    WITHDRAWN,
    Complete,
    Feedback,
    Fragment,
    Headless,
    ListenHint,
    Reason,
    Refused,
)

_MOST_IN_ROUND: Final = BLOCK_FRAGMENTS
# While source fragments are left, another round costs nothing.
_CHEAP_ROUND_FRAMES: Final = 1.0
_MOST_UNHEARD: Final = 10
"""How many fragments go to receivers that may not be there: two runs, each of which shows the
rhythm to other nodes, and the request after them."""
_IN_VAIN: Final = 3
"""After this many requests without an answer a receiver counts as not there."""
_PATIENT_QUESTIONS: Final = 4
_MOST_DOUBLINGS: Final = 6
# Two, so that a request arrives although one of them is lost.
_SHORTEST_ROUND: Final = 2
_FEW_LACKING: Final = 16
_ANSWER_COPIES: Final = 3


class OutgoingObject:
    """One object under way.

    Args:
        transfer: Its number.
        receivers: Addresses of the receivers, each with the known loss on the way there.
        manifest: Its manifest.
        fragments: Its fragments.
        rng: Draws the pauses between unanswered requests.
    """

    is_bulk = False
    """Whether its fragments go by the link's bulk service."""

    def __init__(
        self,
        transfer: int,
        receivers: dict[int, LossEstimate],
        manifest: Manifest,
        fragments: Fragments,
        rng: random.Random,
    ) -> None:
        self.transfer = transfer
        self.manifest = manifest
        self.fragments = fragments
        self.views = {address: ReceiverView(loss) for address, loss in receivers.items()}
        self.next_source = 0
        self.next_seed = [0] * fragments.layout.blocks
        self.transmitted = 0
        """Fragments transmitted in this boot epoch."""
        self.listens = False
        """Whether a request is in transmission or not yet answered."""
        self.is_asking = False
        """Whether it is in transmission. A route takes many frames before it reports the first."""
        self.due_at = 0
        """Instant from which the next fragment may go, ns; while it listens, instant to stop
        listening."""
        self.listens_until = 0
        """Instant until which an answer may come and nothing else should be transmitted, ns."""
        self.asked_at = 0
        """End of the last request, ns."""
        self.is_withdrawn = False
        """Whether it is withdrawn, and its receivers are being told."""
        self._round: deque[int] = deque()
        self._patience_ns = 0
        self._asked: list[ReceiverView] = []
        self._is_answered = False
        """Whether a receiver has answered, and the last request was not in vain."""
        self._rng = rng

    # Records to send

    @property
    def has_fragments(self) -> bool:
        """Whether a receiver needs fragments, or must learn that the object is withdrawn."""
        return self.is_withdrawn or bool(self._lacking())

    def next_at(self, is_turn: Callable[[int], bool]) -> int | None:
        """Return when a record of it may go, ns; None: that depends on an input.

        All receivers await their turn, or a request is in transmission.

        Args:
            is_turn: Returns whether a receiver has everything before it that will ever come.
        """
        if self.is_asking:
            return None
        if self.listens or self.has_fragments:
            return self.due_at
        turns = [self.views[each].turn_at for each in self._holders(is_turn)]
        return max(self.due_at, min(turns)) if turns else None

    def next_turn(self, is_turn: Callable[[int], bool], now: int) -> int | None:
        """Return the receiver of the next turn record; None: a fragment goes."""
        if self.is_withdrawn:
            return None
        due = (each for each in self._holders(is_turn) if self.views[each].turn_at <= now)
        return next(due, None)

    def withdraw(self, now: int) -> None:
        """Stop sending it, and inform the receivers."""
        self.is_withdrawn = True
        self.listens = self.is_asking = False
        self.due_at = now
        for view in self.views.values():
            view.unanswered = 0

    @property
    def is_past_asking(self) -> bool:
        """Whether no receiver has answered for so long that none may be there."""
        return all(view.unanswered > _PATIENT_QUESTIONS for view in self._waiting())

    def resume(self, next_source: int, next_seed: int) -> None:
        """Resume after a restart: nothing from these numbers on has been sent."""
        layout = self.fragments.layout
        self.next_source = min(next_source, layout.fragments)
        self.next_seed = [next_seed] * layout.blocks
        if self.next_source:
            begun = layout.block_of(self.next_source - 1) + 1
            for view in self.views.values():
                view.lacking = dict.fromkeys(range(begun))

    @property
    def waiting(self) -> list[int]:
        """Addresses of the receivers that need anything more."""
        return [each for each, view in self.views.items() if not view.is_finished]

    @property
    def lacking(self) -> list[int]:
        """Addresses of the waiting receivers that are not known to hold all of it."""
        return [each for each in self.waiting if not self.views[each].holds]

    @property
    def is_unheard(self) -> bool:
        """Whether its receivers have had a round without answering, and so may not be there."""
        is_due = self.listens or not self._round
        return is_due and bool(self.transmitted) and not self._is_answered and bool(self._lacking())

    @property
    def is_heard(self) -> bool:
        """Whether a receiver has answered, and the last request was not in vain."""
        return self._is_answered

    def release(self, address: int, now: int) -> None:
        """Make due what waits for a receiver that is back."""
        view = self.views.get(address)
        if view is not None and not view.is_finished:
            self.due_at = min(self.due_at, max(now, self.listens_until))
            view.turn_at = min(view.turn_at, self.due_at)

    def take(
        self, timing: Timing, *, window_follows: bool, is_present: bool, is_silent: bool
    ) -> Fragment:
        """Take the next fragment for transmission.

        Args:
            timing: The durations.
            window_follows: A listen window follows.
            is_present: A receiver was heard just now.
            is_silent: No receiver was heard for long.
        """
        self._asked = self._waiting() if self.is_withdrawn else self._lacking()
        if self.is_withdrawn:
            self.listens = self.is_asking = True
            return Fragment(self.transfer, ListenHint.ANSWER, NO_FRAGMENT, WITHDRAWN)
        if not self._round:
            is_known = self._is_answered or (is_present and not self.is_unheard)
            self._round.extend(self._plan(timing, is_known=is_known, is_silent=is_silent))
        index = self._round.popleft()
        left = len(self._round)
        call = ListenHint.ANSWER
        if left:
            # After a pause the next frame would come later than the receiver expects.
            next_asks = left == 1 and not window_follows
            unasked = ListenHint.WINDOW if window_follows else ListenHint.NONE
            call = ListenHint.ANSWER_NEXT if next_asks else unasked
        return self._mark(index, call)

    def _mark(self, index: int, call: ListenHint) -> Fragment:
        """Record that a fragment is taken for transmission."""
        layout = self.fragments.layout
        block = layout.block_of(index)
        if index == self.next_source < layout.fragments:
            self.next_source += 1
        for view in self.views.values():
            view.lacking.setdefault(block, layout.size(block))
            view.sent[block] = view.sent.get(block, 0) + 1
        self.listens = self.is_asking = call is ListenHint.ANSWER
        self.transmitted += 1
        return Fragment(self.transfer, call, index, self.fragments.fragment(index))

    def take_turn(self, address: int) -> Fragment:
        """Take the turn record of a receiver for transmission."""
        view = self.views[address]
        view.turns += 1
        self.transmitted += 1
        self._asked = [view]
        self.listens = self.is_asking = True
        check = self.manifest.digest[:CHECK_BYTES]
        return Fragment(self.transfer, ListenHint.ANSWER, NO_FRAGMENT, check)

    def transmitted_until(
        self, finished_at: int, timing: Timing, silence_ns: int, *, asks: bool = True
    ) -> None:
        """Record that the transmission of a record has ended.

        Args:
            finished_at: End of the transmission, ns.
            timing: The durations.
            silence_ns: Least pause after a request that receivers do not answer, ns.
            asks: It was a request.
        """
        if asks:
            self.is_asking = False
        if not self.listens:
            self.due_at = finished_at
        if not (self.listens and asks):
            return
        self.asked_at = finished_at
        for view in self._asked:
            view.unanswered += 1
            view.asked = dict(view.sent)
            view.asked_at = finished_at
        alone = len(self._waiting()) == 1 or self._asked[0].holds
        answers = _ANSWER_COPIES if alone else 2 * len(self.views) + 1
        listen_ns = timing.exchange_ns + (answers - 1) * timing.feedback_slot_ns
        self.listens_until = finished_at + listen_ns
        longest_ns = timing.longest_answer_ns or listen_ns << _MOST_DOUBLINGS
        self._patience_ns = min(self._patience_ns, longest_ns)
        for view in self._asked:
            view.turn_at = finished_at + self._pause_ns(timing, listen_ns, view.turns, silence_ns)
            if view.unanswered > _PATIENT_QUESTIONS:
                view.forget_holding()
        waiting = self._lacking() or self._waiting()
        silent = min((view.unanswered for view in waiting), default=0)
        self.due_at = finished_at + self._pause_ns(timing, listen_ns, silent, silence_ns)

    def give_up_listening(self, now: int) -> list[int]:
        """Stop listening when answers are missing; return the receivers that have not answered."""
        self.listens = False
        self.due_at = now
        unanswered = [each for each in self.waiting if self.views[each].unanswered]
        self._is_answered = self._is_answered and len(unanswered) < len(self.waiting)
        return unanswered

    @property
    def is_crossing(self) -> bool:
        """Whether some of it was transmitted, and a receiver is there."""
        if self.is_withdrawn or not self.transmitted:
            return False
        fewest = min((view.unanswered for view in self._waiting()), default=0)
        return fewest - self.listens < _IN_VAIN

    @property
    def is_answered(self) -> bool | None:
        """Whether the only receiver left has answered the last request.

        None if it was not asked, or if there are more.
        """
        waiting = self.waiting
        if len(waiting) != 1:
            return None
        if self.views[waiting[0]].unanswered:
            return False
        return True if self._is_answered else None

    @property
    def destination(self) -> int:
        """Address of its frames: that of the only receiver left, so that no other one answers."""
        waiting = [each for each, view in self.views.items() if not view.is_finished]
        return waiting[0] if len(waiting) == 1 else BROADCAST

    @property
    def fragment_bytes(self) -> int:
        """Bytes of data in the next fragment."""
        return len(WITHDRAWN) if self.is_withdrawn else self.fragments.layout.fragment_bytes

    def is_repair(self, index: int) -> bool:
        """Return whether an index is that of a repair fragment."""
        return self.fragments.layout.fragments <= index < NO_FRAGMENT

    def next_seeds(self) -> int:
        """Return a seed above those of all fragments sent so far."""
        return max(self.next_seed)

    # Feedback

    def answered(self, source: int, feedback: Feedback, now: int) -> bool:
        """Take a feedback; return False when it is not new or not about this object."""
        view = self.views.get(source)
        if view is None or view.is_finished:
            return False
        layout = self.fragments.layout
        if isinstance(feedback, Complete):
            if feedback.check == self.manifest.digest[:CHECK_BYTES]:
                view.complete = True
                view.learn(layout, view.asked or view.sent, view.first, {})
            elif self.is_withdrawn:
                view.refused = Reason.CANCELLED  # nothing of this object has arrived
            else:
                # It has an object from an earlier boot epoch of ours: the manifest will show it.
                view.headless = True
        elif isinstance(feedback, Refused):
            view.refused = feedback.reason
        elif view.asked is None:
            return False  # a copy of an answer that was taken
        elif isinstance(feedback, Headless):
            view.take_count(layout, view.asked, feedback.held)
        else:
            view.take_lacks(layout, view.asked, feedback)
        if view.asked is not None:
            # Medium access may delay answers: wait as long as that takes.
            self._patience_ns = max(self._patience_ns * 7 // 8, (now - view.asked_at) * 5 // 4)
        view.asked = None
        view.unanswered = 0
        self._is_answered = True
        if not any(view.unanswered for view in self._asked if not view.is_finished):
            self.listens = False
            self.due_at = now
            self._round.clear()
        return True

    def standing(self, address: int) -> tuple[object, ...] | None:
        """Return what shows whether a receiver gets on; None: it is no receiver."""
        view = self.views.get(address)
        if view is None:
            return None
        lacking = sum(each or 0 for each in view.lacking.values())
        unknown = sum(each is None for each in view.lacking.values())
        return view.is_finished, view.holds, view.headless, view.held, view.first, lacking, unknown

    def handed_on(self, address: int) -> bool:
        """Note that a receiver has delivered it; return False if that was known."""
        view = self.views.get(address)
        if view is None or view.is_finished:
            return False
        view.complete = True
        if self.listens and not any(
            each.unanswered for each in self._asked if not each.is_finished
        ):
            self.listens = False
        return True

    def is_for(self, receivers: Set[int]) -> bool:
        """Return whether one of these receivers should get it, or any receiver has it."""
        return any(view.complete or each in receivers for each, view in self.views.items())

    def keep_only(self, receivers: Set[int]) -> bool:
        """Drop the other receivers that do not have it; return whether there were any."""
        leaving = [
            each for each, view in self.views.items() if each not in receivers and not view.complete
        ]
        for each in leaving:
            view = self.views.pop(each)
            self._asked = [other for other in self._asked if other is not view]
        return bool(leaving)

    @property
    def is_finished(self) -> bool:
        """Whether no receiver needs anything more."""
        return all(view.is_finished for view in self.views.values())

    @property
    def missing(self) -> tuple[int, ...]:
        """Receivers that are not known to have it."""
        return tuple(address for address, view in self.views.items() if not view.complete)

    @property
    def delivered_fragments(self) -> int:
        """Number of source fragments that every receiver is known to have, or could solve for."""
        layout = self.fragments.layout
        held = [
            layout.fragments
            if view.complete
            else layout.first(min(view.first, layout.blocks))
            + sum(
                layout.size(block) - lacking
                for block, lacking in view.lacking.items()
                if block >= view.first and lacking is not None
            )
            for view in self.views.values()
            if view.refused is None
        ]
        return min(held, default=0)

    @property
    def done_bytes(self) -> int:
        """Bytes of the payload that every receiver is known to have."""
        delivered_bytes = self.delivered_fragments * self.fragments.layout.fragment_bytes
        return min(self.manifest.payload_bytes, delivered_bytes)

    @property
    def sent_bytes(self) -> int:
        """Bytes of the payload that were transmitted at least once, in any boot epoch.

        Repair fragments count where the receivers could solve for more than was sent plainly.
        """
        sent_bytes = self.next_source * self.fragments.layout.fragment_bytes
        return min(self.manifest.payload_bytes, max(sent_bytes, self.done_bytes))

    # Below the methods above

    def _waiting(self) -> list[ReceiverView]:
        return [view for view in self.views.values() if not view.is_finished]

    def _lacking(self) -> list[ReceiverView]:
        """Return the receivers that are not known to hold all fragments."""
        return [view for view in self._waiting() if not view.holds]

    def _holders(self, is_turn: Callable[[int], bool]) -> list[int]:
        """Return the receivers that wait for their turn and may have it."""
        return [
            each
            for each, view in self.views.items()
            if view.holds and not view.is_finished and is_turn(each)
        ]

    def _plan(self, timing: Timing, *, is_known: bool, is_silent: bool) -> Iterator[int]:
        """Return the indices of the next round.

        Args:
            timing: The durations.
            is_known: A receiver is known to be there.
            is_silent: No receiver was heard for long.
        """
        layout = self.fragments.layout
        waiting = self._lacking()
        silent = all(view.unanswered for view in waiting)
        planned: list[int] = []
        unknown = any(None in view.lacking.values() for view in waiting)
        if (silent and not is_known) or (self.next_source == layout.fragments and unknown):
            return self._probe(timing, waiting, is_silent=is_silent)
        if any(view.headless for view in waiting):
            planned += self._head()
        # Where the source fragments of a block are not all sent, the rest of them goes first.
        behind = [
            each for each in self._behind(waiting) if layout.first(each + 1) <= self.next_source
        ]
        typical = max((view.loss for view in waiting), key=lambda loss: loss.received)
        more = self.next_source < layout.fragments and len(behind) < MOST_BLOCKS
        cost = self._round_frames(timing, waiting) / max(1, len(behind))
        for block in behind:
            needs = [need for view in waiting if (need := view.need(block, typical)) is not None]
            if needs:
                number = repairs_to_send(
                    needs, _CHEAP_ROUND_FRAMES if more else cost, _MOST_IN_ROUND
                )
                if planned and block == 0:
                    # The manifest is worth as much as a repair fragment, and must arrive.
                    number -= len(planned)
                    if number < _FEW_LACKING:
                        number += len(planned)
                        planned += self._head()
                planned += self._repairs(block, number)
        if more:
            block = layout.block_of(self.next_source)
            end = layout.first(block + 1)
            if not is_known:
                end = min(end, self.next_source + max(1, _MOST_UNHEARD - len(planned)))
            planned += range(self.next_source, end)
        return iter(planned or self._probe(timing, waiting, is_silent=is_silent))

    def _behind(self, waiting: list[ReceiverView]) -> list[int]:
        """Return the blocks with sent and missing fragments."""
        return sorted(
            {block for view in waiting for block, lacking in view.lacking.items() if lacking != 0}
        )

    def _probe(
        self, timing: Timing, waiting: list[ReceiverView], *, is_silent: bool
    ) -> Iterator[int]:
        """Plan a short round: no receiver has answered, or their losses are unknown."""
        behind = self._behind(waiting) or [self.fragments.layout.blocks - 1]
        lacking = max(view.lacking.get(behind[-1]) or 1 for view in waiting)
        number = min(timing.run_frames, lacking)
        fewest = min(view.unanswered for view in waiting)
        if is_silent or fewest >= _PATIENT_QUESTIONS:
            # Who takes the number for an earlier object, and is silent about that one, learns its
            # error from the manifest alone.
            if fewest % 2 and (head := self._head()):
                return iter([head[fewest // 2 % len(head)]])
            return iter(self._repairs(behind[-1], 1))
        head = self._head() if any(view.headless for view in waiting) else []
        number = max(number, _SHORTEST_ROUND - len(head))
        return iter(head + self._repairs(behind[-1], number))

    def _head(self) -> list[int]:
        """Return the fragments with the manifest."""
        last = (self.manifest.size_bytes - 1) // self.fragments.layout.fragment_bytes
        return list(range(min(last + 1, self.next_source)))

    def _repairs(self, block: int, number: int) -> list[int]:
        first = self.next_seed[block]
        number = max(0, number)
        self.next_seed[block] = first + number
        layout = self.fragments.layout
        return [layout.repair(block, seed) for seed in range(first, first + number)]

    @staticmethod
    def _round_frames(timing: Timing, waiting: list[ReceiverView]) -> float:
        """Return the cost of a request in frames: the exchange, repeated where it is lost."""
        loss = max((view.loss.loss for view in waiting), default=0.0)
        answered = (1 - loss**2) * (1 - loss**_ANSWER_COPIES)
        return timing.exchange_ns / timing.slot_ns / max(0.1, answered)

    def _pause_ns(self, timing: Timing, listen_ns: int, questions: int, silence_ns: int) -> int:
        """Return the pause after a number of requests without a useful answer, ns."""
        # Two sources that ask in one rhythm would never be heard.
        is_step = questions > 1 or not timing.senses_carrier
        drawn_ns = self._rng.randrange(timing.slot_ns) if is_step else 0
        return max(max(self._patience_ns, listen_ns) + drawn_ns, silence_ns)
