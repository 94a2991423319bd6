"""One direction of one route at one node: the frames in its custody, and its trains.

Frames go in trains of up to twelve, since sound is slow: a train shares the way of its sound. The
node after receives it, then transmits it, and this node hears what has arrived there.

============  ===========================================  =======================================
state         event                                        then
============  ===========================================  =======================================
idle          frames wait and the channel is free          a train: each frame says whether another
                                                           one follows
in a train    its last frame has ended                     awaiting, with a pause
awaiting      all its frames are heard further along, or   idle; what is missing waits again
              the next node's train or hop
              acknowledgement is over
awaiting      the pause is over                            idle, the same; the next pause is longer
============  ===========================================  =======================================

A frame is given up after eight tries, or when it is too old. After as many vain pauses without any
sign of the next node, each further frame has one try only, until that node is heard: its end
repeats it, and waits ever longer.
"""

from typing import Final

from zacoustic.core.relay.custody import Custody, Stage

LONGEST_TRAIN: Final = 12
"""The most frames of a train."""
MOST_TRIES: Final = 8
"""How often a node transmits a frame of a route at most."""
_MOST_UNHEARD: Final = 8
_MOST_VAIN: Final = 64
"""After so many vain pauses in a row the next node counts as silent: if it was not heard meanwhile,
and in any case."""


class Flow:
    """One direction of a route.

    Args:
        route: Number of the route.
        to_next: Address of the next node; None: this node is the end.
        is_back: Whether frames go to the first node of the path.
        next_is_end: Whether the next node is the end.
    """

    __slots__ = (
        "_train", "frames", "given_up", "is_awaiting", "is_back", "next_is_end", "passed_on",
        "route", "to_next", "transmissions", "unheard", "vain", "was_answered",
    )  # fmt: skip

    def __init__(
        self, route: int, to_next: int | None, *, is_back: bool, next_is_end: bool
    ) -> None:
        self.route = route
        self.is_back = is_back
        self.to_next = to_next
        self.next_is_end = next_is_end
        self.frames: dict[int, Custody] = {}
        """The frames in custody by number, in the order in which they came."""
        self.is_awaiting = False
        """Whether a sign of the next node is awaited."""
        self.was_answered = False
        """Whether a frame of the last train was heard further along."""
        self.vain = 0
        """How many pauses in a row were over without any sign."""
        self.unheard = 0
        """How many of these since the next node was last heard on this route."""
        self.passed_on = 0
        """How many frames a node further along the path has."""
        self.transmissions = 0
        self.given_up = 0
        self._train = 0

    @property
    def is_silent(self) -> bool:
        """Whether the next node was silent for so long that it may be absent, or have restarted."""
        return self.unheard >= _MOST_UNHEARD or self.vain >= _MOST_VAIN

    @property
    def is_in_train(self) -> bool:
        """Whether the last frame has announced another one."""
        return self._train > 0

    def first_waiting(self) -> Custody | None:
        """Return the frame that goes next; None: none waits, or an answer is awaited.

        An urgent one goes first, and awaits no answer to others.
        """
        first: Custody | None = None
        for each in self.frames.values():
            if each.stage is Stage.WAITING:
                if each.is_urgent:
                    return each
                first = first or each
        return None if self.is_awaiting else first

    def begin(self) -> Custody:
        """Begin to transmit the first waiting frame; `is_in_train` tells whether another follows.

        Returns:
            The frame.
        """
        custody = self.first_waiting()
        assert custody is not None
        if not self.is_in_train:
            self.was_answered = False
        custody.stage = Stage.ON_AIR
        custody.tries += 1
        self.transmissions += 1
        # An urgent one ends its train, so that the next node can send it on at once.
        has_room = self._train + 1 < LONGEST_TRAIN and not custody.is_urgent
        has_more = has_room and self.first_waiting() is not None
        self._train = self._train + 1 if has_more else 0
        return custody

    def has(self, stage: Stage) -> bool:
        """Return whether a frame is in a stage."""
        return any(each.stage is stage for each in self.frames.values())

    def has_stopped(self) -> bool:
        """Return whether a train is over now; so it is if nothing is left of what it announced."""
        if self.has(Stage.ON_AIR) or (self.is_in_train and self.has(Stage.WAITING)):
            return False
        self._train = 0
        return True

    def awaits_urgent(self) -> bool:
        """Return whether a sign of an urgent frame is awaited."""
        return any(each.is_urgent and each.stage is Stage.AWAITING for each in self.frames.values())

    def again(self, now: int, *, urgent_only: bool = False) -> list[Custody]:
        """Let the frames that were not heard further along wait again.

        Returns:
            Those that are given up instead.
        """
        self.is_awaiting = False
        most_tries = 1 if self.is_silent else MOST_TRIES
        given_up = []
        for each in self.frames.values():
            if each.stage is Stage.AWAITING and (each.is_urgent or not urgent_only):
                each.stage = Stage.WAITING
                if each.tries >= most_tries or now >= each.expires_at:
                    given_up.append(each)
        return given_up
