"""A node that may have forgotten something shows its boot epoch to those who would tell it again.

The problem: without a journal, or with one that is new or in doubt, a publisher does not know who
subscribed before its start. Its subscribers send their messages again when they hear anything of
the new boot epoch, but a publisher without subscribers sends nothing.

The idea: whenever a program publishes on an on-demand topic while some node that may subscribe is
not known to have heard this boot epoch, the publisher transmits one small frame to all, which names
the epoch. The pauses between such frames double, and after some minutes they are a share of the
time since the first one: some forty frames in a day in which nobody answers. Nothing is published,
nothing is sent.

A node that has forgotten what late joiners of latched topics get does the same when its link is up
for the first time, but four times only: their publishers may have nothing to say for hours, and
send the last samples again when they know the boot epoch (`zacoustic.core.transport.topics`).
"""

from collections.abc import Callable
from typing import Final

from zacoustic.core.base.journal import LIFE_KEY
from zacoustic.core.base.qos import Durability
from zacoustic.core.base.timers import Due
from zacoustic.core.peers.peer import Pause
from zacoustic.core.schedule.context import Context
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions

_LONGEST_PAUSE_UNITS: Final = 256
_TIMES: Final = 4
_FIRST_PAUSE_UNITS: Final = 8
_DOUBLINGS: Final = 2


class Announcing:
    """The announcements of one node on one link.

    Args:
        context: What the components of its engine share.
        subscriptions: Knows the subscribers, and tells of publications.
        announce: Transmits a frame to all that names the boot epoch: ``(now)``.
    """

    def __init__(
        self, context: Context, subscriptions: Subscriptions, announce: Callable[[int], None]
    ) -> None:
        self._address = context.address
        self._link = context.link
        self._table = context.table
        self._others = context.others
        self._timers = context.timers
        self._handshake = context.handshake
        self._peers = context.peers
        self._subscriptions = subscriptions
        self._announce = announce
        self._pause = Pause(_LONGEST_PAUSE_UNITS)
        self._times_left = 0
        if bool(context.doubt.reason) or not has_lived(context):
            self._times_left = _TIMES
            subscriptions.published.connect(self._published)

    def link_up(self, now: int) -> None:
        """Note that the link is up: for the first time, it may lack samples of latched topics."""
        if self._times_left == _TIMES:
            self._ask(now)

    # Below the methods above

    def _published(self, stream: Stream, now: int) -> None:
        if now >= self._pause.not_before and self._may_be_forgotten(stream):
            self._pause.use(now, self._handshake.owing.unit_ns)
            self._say(now)

    def _ask(self, now: int) -> None:
        """Show the boot epoch to the publishers of latched topics."""
        if not self._times_left or all(self._knows_us(each) for each in self._latched_by()):
            return
        self._times_left -= 1
        self._say(now)
        units = _FIRST_PAUSE_UNITS << _DOUBLINGS * (_TIMES - 1 - self._times_left)
        at = now + units * self._handshake.owing.unit_ns
        if self._times_left:
            self._timers.at((Due.ANNOUNCEMENT,), at, self._ask)

    def _say(self, now: int) -> None:
        self._handshake.introductions.announce(self._link)
        self._announce(now)

    def _latched_by(self) -> set[int]:
        """Return the nodes whose latched samples are for this one."""
        return {
            each
            for stream in self._table
            if isinstance(stream.spec, TopicSpec)
            and stream.qos.durability is Durability.TRANSIENT_LOCAL
            and stream.may_subscribe(self._address)
            for each in self._others or stream.spec.publishers or ()
            if each != self._address and stream.may_publish(each)
        }

    def _may_be_forgotten(self, stream: Stream) -> bool:
        """Return whether a node may have subscribed that has not heard this boot epoch."""
        assert isinstance(stream.spec, TopicSpec)
        known = self._subscriptions.subscribers(stream) or frozenset()
        others = self._others or stream.spec.subscribers or ()
        return any(
            stream.may_subscribe(each) and each not in known and not self._knows_us(each)
            for each in others
            if each != self._address
        )

    def _knows_us(self, address: int) -> bool:
        peer = self._peers.get(address)
        return peer is not None and peer.knows_us


def has_lived(context: Context) -> bool:
    """Return whether the journal shows an earlier start of this node."""
    return int.from_bytes(context.stored.get(LIFE_KEY, b""), "big") > 1
