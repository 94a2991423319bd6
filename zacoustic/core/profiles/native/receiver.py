"""Decodes and checks received frames, and dispatches their content.

Nothing here raises, whatever arrives. Each drop is counted under one word:

======================  ===================================================================
``short check stuffing  the envelope could not be opened (`zacoustic.core.wire.envelope`)
overlong address``
``own not_for_us``      a frame of this address, or for another one
``echo``                the same bytes again sooner than the sender can have sent them
``version``             a frame of another wire version
``truncated reserved    the frame cannot be decoded further (`zacoustic.core.wire.frame`), or a
unknown_stream``        record of a service or action has prefixes
``unconfirmed differs`` the tables are not known to agree (`zacoustic.core.peers.handshake`)
``stranger``            an item that needs an answer, from a node outside of the table's list
``not_publisher         the table does not allow this record between these nodes
not_subscriber``
``weak``                a command, call or goal in a frame with the short tag
``payload``             the content does not decode, or is out of the bounds of its type
``dense``               a dense block that is damaged, or refers to one that is not held here
``unexpected_answer     an answer to no call, or too late; a request that came before
repeated_request
repeated_goal``
``stale_subscribe``     outdated subscriptions of a node
``repeated_sample       a reliable sample that came before; one whose count is not known here
out_of_sync``
``unexpected_ack``      an acknowledgement of nothing, or from an earlier boot epoch
``too_many_calls        more requests or goals of one client than two of its boot epochs allow
too_many_goals``
``reply_budget``        a fragment or question of a node that has spent its reply budget (sealed)
``former_life``         a request or goal from a boot epoch of its client that is over: replayed
``suspended``           a request or goal that may be older than this boot epoch, while this
                        node may have forgotten some; its client repeats it
``old_cancel``          a cancel of a goal, or its refusal, before the last one
``object_answer         feedback about no object of this node, or repeated; an object that
object_digest           contradicts its digest; more transfers than are kept
object_room``
======================  ===================================================================
"""

from collections.abc import Callable, Iterator, Set
from functools import partial

import msgspec

from zacoustic.core.base.linktypes import ReceivedFrame
from zacoustic.core.base.qos import Reliability
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.reception import Heard, HearingPort, Reception
from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.schedule.linkseal import Unsealed
from zacoustic.core.schedule.replybudget import ReplyBudget
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Ask, Hello
from zacoustic.core.wire.content import measure_content
from zacoustic.core.wire.controls import Item
from zacoustic.core.wire.envelope import Opened
from zacoustic.core.wire.frame import Prefixes, Record, Stray, parse_frame
from zacoustic.core.wire.objects import Fragment

_NO_PREFIXES = Prefixes()
_REPEATED = frozenset({"repeated_request", "repeated_goal", "repeated_sample"})
"""A node that repeats these has not received the answer."""


class Receiver:
    """Decodes opened frames.

    Args:
        table: The streams of this node.
        handshake: Decides what may be decoded.
        reception: Knows which component takes what.
        stats: Counts what is dropped.
        seal: Decides which records need the long tag.
        replies: Knows which nodes get no answer now.
        forbidden: Takes source, stream and instant of a record that its source may not send, where
            that is authentic.
    """

    def __init__(
        self,
        table: StreamTable,
        handshake: Handshake,
        reception: Reception,
        stats: EngineStats,
        seal: Unsealed,
        replies: ReplyBudget,
        forbidden: Callable[[int, int, int], None],
    ) -> None:
        self._forbidden = forbidden
        self._seal = seal
        self._replies = replies
        self._table = table
        self._handshake = handshake
        self._reception = reception
        self._stats = stats

    def handle(
        self, opened: Opened, received: ReceivedFrame, port: HearingPort, now: int
    ) -> tuple[int, ...]:
        """Decode one frame; return the streams of its content."""
        heard = self._heard(opened, received, port, now)
        self._handshake.begin_frame(
            heard.source, len(opened.records), now, unicast=heard.is_unicast
        )
        if opened.life is not None:
            self._handshake.authentic(heard.source, opened.life, opened.digest, now)
            heard.epoch, heard.is_strong = opened.life, opened.strong
        items: list[Item] = []
        for item in self._items(opened, unicast=heard.is_unicast):
            self._drop(self._reception.first(heard, item))
            if heard.is_foreign:
                break
            items.append(item)
        for item in items:
            reason = self._take(heard, item)
            self._drop(reason)
            if reason == "not_publisher" and opened.life is not None and isinstance(item, Record):
                self._forbidden(heard.source, item.stream_id, now)
            if reason in _REPEATED:
                self._reception.came_again(heard.source)
        if heard.streams and heard.epoch is not None:
            self._handshake.heard_introduced(
                heard.source, heard.epoch, now, unicast=heard.is_unicast
            )
        self._reception.read(heard.source, now)
        return tuple(heard.streams)

    def handle_unsealed(
        self,
        opened: Opened,
        received: ReceivedFrame,
        port: HearingPort,
        allowed: Set[int],
        now: int,
    ) -> tuple[int, ...]:
        """Take samples of the allowed topics from an unsealed frame; return their streams.

        Its sender is unknown, so nothing else in it is believed, and no count of samples is.
        """
        heard = self._heard(opened, received, port, now)
        for item in self._items(opened, unicast=heard.is_unicast):
            if not isinstance(item, Record) or item.stream_id not in allowed:
                continue
            stream = self._table.by_id(item.stream_id)
            if item.prefixes.acknowledged is None and item.prefixes.sync is None:
                reason = self._reception.record(heard, stream, item)
                self._drop(reason)
                if reason is None:
                    heard.streams.append(item.stream_id)
        return tuple(heard.streams)

    def overhear(
        self, opened: Opened, received: ReceivedFrame, port: HearingPort, now: int
    ) -> None:
        """Take what concerns all nodes from a frame for another node."""
        heard = self._heard(opened, received, port, now)
        for item in self._items(opened, unicast=True):
            if isinstance(item, Hello) and item.version != WIRE_VERSION:
                break
            self._reception.overheard(heard, item)

    # Below the methods above

    def _heard(self, opened: Opened, received: ReceivedFrame, port: HearingPort, now: int) -> Heard:
        if received.destination != opened.destination:
            # The frame's own destination, which a link without addresses does not know.
            received = msgspec.structs.replace(received, destination=opened.destination)
        return Heard(opened.source, received, port, self._handshake, now, len(opened.records))

    def _items(self, opened: Opened, *, unicast: bool) -> Iterator[Item]:
        measure = partial(self._measure, opened.source)
        return parse_frame(opened.records, measure, CONTROLS, unicast=unicast)

    def _take(self, heard: Heard, item: Item) -> str | None:
        """Take an item in the second pass; return why it is dropped, or None."""
        if isinstance(item, Stray):
            return item.reason
        if not self._table.lists(heard.source) and self._is_answered(item):
            return "stranger"
        if isinstance(item, Ask | Fragment) and self._replies.refuses(heard.source, heard.now):
            return "reply_budget"
        if not isinstance(item, Record):
            return self._reception.second(heard, item)
        heard.streams.append(item.stream_id)
        is_ack = item.prefixes.acknowledged is not None
        stream = self._table.get(item.stream_id)
        needs_verdict = not is_ack and not (
            self._handshake.is_sealed and stream is not None and stream.is_built_in
        )
        reason = heard.refusal(item.stream_id) if needs_verdict else None
        if reason is not None:
            return reason
        if stream is None:
            return "unknown_stream"
        if item.prefixes != _NO_PREFIXES and not isinstance(stream.spec, TopicSpec):
            return "reserved"
        if self._seal.refuses(stream, strong=heard.is_strong):
            return "weak"
        give = self._reception.ack if is_ack else self._reception.record
        return give(heard, stream, item)

    def _is_answered(self, item: Item) -> bool:
        """Return whether this node would answer or keep an item: only its fleet gets that."""
        if not isinstance(item, Record):
            return isinstance(item, Fragment)
        stream = self._table.get(item.stream_id)
        is_best_effort = stream is not None and (
            isinstance(stream.spec, TopicSpec) and stream.qos.reliability is Reliability.BEST_EFFORT
        )
        return item.prefixes.acknowledged is None and not is_best_effort

    def _drop(self, reason: str | None) -> None:
        if reason is not None:
            self._stats.drop(reason)

    def _measure(
        self, source: int, stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes
    ) -> int | None:
        stream = self._table.get(stream_id)
        if stream is None:
            raise KeyError(stream_id)
        if self._handshake.is_sealed and not self._handshake.may_measure(source, stream):
            return None
        return measure_content(stream, buffer, offset, prefixes, source)
