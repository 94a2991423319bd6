"""A sender's state for one receiver of an object."""

from zacoustic.core.transport.objects.code.code import Layout
from zacoustic.core.transport.objects.sending.planning import LossEstimate, Need
from zacoustic.core.wire.objects import Lacks


class ReceiverView:
    """What the sender knows of one receiver."""

    def __init__(self, loss: LossEstimate) -> None:
        self.loss = loss
        self.complete = False
        self.refused: int | None = None
        """The reason why it refuses the object."""
        self.headless = False
        """Whether it lacks the manifest."""
        self.held = 0
        """Fragments that it had when it lacked the manifest."""
        self.first = 0
        """All blocks before this one are complete."""
        self.lacking: dict[int, int | None] = {}
        """Lacking fragments of the blocks of which any were sent; None: unknown, from before a
        restart."""
        self.sent: dict[int, int] = {}
        """Fragments of each block sent since the last request that it answered."""
        self.asked: dict[int, int] | None = None
        """How many of them were sent before the last request; None: that is answered."""
        self.asked_at = 0
        """End of that request, ns."""
        self.unanswered = 0
        """Requests since its last answer."""
        self.holds = False
        """Whether it has all fragments and waits for its turn."""
        self.turns = 0
        """How often its turn was sent."""
        self.turn_at = 0
        """Instant from which its turn may be sent again, ns."""

    @property
    def is_finished(self) -> bool:
        """Whether it needs nothing more."""
        return self.complete or self.refused is not None

    def forget_holding(self) -> None:
        """Assume that it has lost the object, which it no longer reports to hold."""
        if self.holds:
            self.holds, self.turns = False, 0
            self.lacking = dict.fromkeys(self.lacking)

    def need(self, block: int, typical: LossEstimate) -> Need | None:
        """Return what it probably needs of a block, or None.

        Args:
            block: The block.
            typical: The typical loss, for a receiver without a known one.
        """
        lacking = self.lacking.get(block)
        if not lacking:
            return None
        loss = self.loss if self.loss.is_known else typical
        # It has not answered since: assume that this many of the fragments have arrived.
        arrived = round(self.sent.get(block, 0) * (1 - loss.loss))
        return Need(max(1, lacking - arrived), loss.received, loss.lost)

    def answered_for(self, asked: dict[int, int]) -> None:
        """Discount the fragments that were sent before the request; later ones stay counted."""
        self.sent = {
            block: left
            for block, number in self.sent.items()
            if (left := number - asked.get(block, 0)) > 0
        }

    def take_lacks(self, layout: Layout, asked: dict[int, int], lacks: Lacks) -> None:
        """Take its feedback about what it lacks.

        Args:
            layout: How the object is cut.
            asked: How many fragments of each block were sent before the request.
            lacks: The feedback.
        """
        self.headless = False
        self.holds = lacks.is_nothing and lacks.block == layout.blocks
        if self.holds:
            self.learn(layout, asked, layout.blocks, {})
            return
        self.turns = 0
        told = dict(enumerate(lacks.lacking, lacks.block))
        if max(told) >= layout.blocks or any(
            lacking > layout.size(block) for block, lacking in told.items()
        ):
            # It refers to another object: the manifest will show it.
            self.headless = True
            return
        self.learn(layout, asked, lacks.block, told)

    def learn(
        self, layout: Layout, asked: dict[int, int], first: int, told: dict[int, int]
    ) -> None:
        """Learn from what it lacked and lacks now how many fragments have arrived.

        Args:
            layout: How the object is cut.
            asked: How many fragments of each block were sent before the request.
            first: All blocks before this one are complete.
            told: How many fragments it lacks of the reported blocks.
        """
        self.first = first
        for block, before in list(self.lacking.items()):
            if block < first or self.complete:
                after = 0
            else:
                after = told.get(block, layout.size(block))
            sent = asked.get(block, 0)
            if before is not None and before > 0:
                arrived = max(0, before - after)
                # Fragments after the last needed one are not reported: do not count them.
                self.loss.learn(sent if after else min(sent, max(arrived, 1)), arrived)
            self.lacking[block] = after
        self.answered_for(asked)

    def take_count(self, layout: Layout, asked: dict[int, int], held: int) -> None:
        """Take its feedback that it lacks the manifest but has a number of fragments."""
        self.forget_holding()
        self.headless = True
        self.loss.learn(sum(asked.values()), held - self.held)
        self.held = held
        self.answered_for(asked)
        if layout.blocks == 1:
            self.lacking[0] = max(1, layout.fragments - held)
            return
        for block in self.lacking:
            expected = layout.size(block) * self.loss.loss
            self.lacking[block] = max(1, round(expected))
