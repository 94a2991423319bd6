"""Whether one link of a bond reaches one node.

=========  ==================================  =========
State      Event                               Next
=========  ==================================  =========
``DOWN``   the node has answered on the link   ``UP``
``UP``     an answer is overdue                ``DOUBT``
``DOUBT``  the node has answered on the link   ``UP``
``DOUBT``  no answer for `silence_s`           ``DOWN``
any        the device is gone                  ``DOWN``
=========  ==================================  =========

In ``DOUBT`` frames go by this link and by the next one, and the node is asked three times. A frame
goes by both as well when the node was just heard on a link that is down: that proves one direction
only, for a vehicle at the edge of radio coverage hears the mast, which does not hear the vehicle. A
link that was up for less than a minute is tried again after twice the pause before.

On a link whose receivers do not answer, silence counts: it goes from ``UP`` to ``DOWN`` when the
node was not heard for `silence_s` while several frames went, and back when it is heard. Until then
a frame in each `pause_s` goes by this link as well: two nodes that both think so would use the next
one for ever. The last such link of a bond stays ``UP``.
"""

import enum
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.bond.spec import BondLink

_FLAP_NS: Final = 60 * NS_PER_S
"""A link that goes down sooner after it was up counts as unsteady."""
_FRESH_NS: Final = 10 * NS_PER_S
"""What was heard on a link counts for so long without more."""
_LONGEST_PAUSE: Final = 12
"""The pause grows to at most this many times what the rules say."""
_QUESTIONS: Final = 3
"""How often a node is asked on a link in doubt."""
_UNHEARD: Final = 8
"""So many frames may go unheard where receivers do not answer."""


class Reach(enum.Enum):
    """Whether a link reaches a node."""

    DOWN = "down"
    """It does not, or nobody knows."""
    DOUBT = "doubt"
    """It did, or it may: frames go by the next link as well."""
    UP = "up"
    """It does."""


class PeerReach:
    """What is known of one node on one link.

    Args:
        rules: How the bond treats the link.
        is_last: Whether there is no other one after it.
    """

    __slots__ = (
        "_answered_at", "_asks_at", "_doubted_at", "_heard_at", "_is_last", "_pauses", "_rules",
        "_try_at", "_unheard", "_up_at", "state",
    )  # fmt: skip

    def __init__(self, rules: BondLink, *, is_last: bool = False) -> None:
        self._rules = rules
        self._is_last = is_last
        self.state = Reach.DOWN if rules.answers else Reach.UP
        """Whether the link reaches the node."""
        self._answered_at = self._doubted_at = self._up_at = self._try_at = self._asks_at = 0
        self._heard_at: int | None = None
        self._unheard = 0
        self._pauses = 1

    def heard(self, now: int) -> None:
        """Take that a frame of the node has come by this link."""
        self._heard_at, self._unheard = now, 0
        if not self._rules.answers:
            self.state = Reach.UP

    def answered(self, now: int) -> None:
        """Take that the node has answered a frame that came to it by this link."""
        if self.state is not Reach.UP:
            self._up_at = now
        self.state, self._answered_at = Reach.UP, now

    def is_sure(self, now: int) -> bool:
        """Return whether the link reaches the node, and that was seen a short while ago."""
        is_fresh = not self._rules.answers or now - self._answered_at <= _FRESH_NS
        return self.state is Reach.UP and is_fresh

    def is_hopeful(self, now: int) -> bool:
        """Return whether a frame is to go by a link that is down as well.

        The node was just heard on it; where receivers do not answer, a frame is the only question.
        """
        if not self._rules.answers:
            return self.may_try(now)
        heard_at = self._heard_at
        return heard_at is not None and now - heard_at <= _FRESH_NS and self.may_try(now)

    def overdue(self, now: int) -> None:
        """Take that an answer did not come in time."""
        if self.state is Reach.UP:
            self.state, self._doubted_at, self._asks_at = Reach.DOUBT, now, now

    def transmitted(self, now: int) -> None:
        """Take that a frame for the node goes by this link."""
        if self._rules.answers or self._is_last:
            return
        if self.state is Reach.DOWN:
            self.tried(now)
            return
        if self._heard_at is None:
            self._heard_at = now
        self._unheard += 1
        silence_ns = seconds_to_ns(self._rules.silence_s)
        if self._unheard > _UNHEARD and now - self._heard_at >= silence_ns:
            self._down(now)

    def review(self, now: int) -> None:
        """Give up a link in doubt when its time is over."""
        if self.state is Reach.DOUBT and now >= self.doubt_ends_at:
            self._down(now)

    @property
    def asks_at(self) -> int:
        """The instant at which to ask the node on a link in doubt, ns."""
        return self._asks_at

    def asked(self, now: int) -> None:
        """Take that the node is asked on a link in doubt."""
        self._asks_at = now + seconds_to_ns(self._rules.silence_s) // _QUESTIONS

    @property
    def doubt_ends_at(self) -> int:
        """The instant at which a link in doubt is given up, ns."""
        return self._doubted_at + seconds_to_ns(self._rules.silence_s)

    def lost(self, now: int) -> None:
        """Take that the device is gone."""
        if self._rules.answers:
            self.state = Reach.DOWN

    def may_try(self, now: int) -> bool:
        """Return whether it is time to try the link again."""
        return self.state is Reach.DOWN and now >= self._try_at

    def tried(self, now: int) -> None:
        """Take that the link is tried now."""
        self._try_at = now + self._pauses * seconds_to_ns(self._rules.pause_s)

    @property
    def next_try_at(self) -> int:
        """The instant of the next try of a link that is down, ns."""
        return self._try_at

    # Below the methods above

    def _down(self, now: int) -> None:
        is_unsteady = now - self._up_at < _FLAP_NS
        self._pauses = min(2 * self._pauses, _LONGEST_PAUSE) if is_unsteady else 1
        self.state = Reach.DOWN
        self.tried(now)
