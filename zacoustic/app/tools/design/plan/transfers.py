"""An object in the model: rounds of fragments, each ending with a request for feedback.

The number of repair fragments in a round is the sender's own decision (`repairs_to_send`), from its
estimate of the loss. Everything else is docs/wire.md section 9.
"""

from typing import Final

from zacoustic.app.tools.design.plan.clockwork import Clockwork
from zacoustic.app.tools.design.plan.items import Item
from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.schedule.access.listening import Listening
from zacoustic.core.transport.objects.code.code import BLOCK_FRAGMENTS, Layout
from zacoustic.core.transport.objects.sending.planning import LossEstimate, Need, repairs_to_send
from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.wire.objects import FEEDBACK_BYTES, FRAGMENT_HEADER_BYTES, ListenHint

MANIFEST_BYTES: Final = 17
"""Without instance bytes and encoding, for an object of 128 bytes to 16 kB."""
_FIRST_COPY: Final = 0.1
_SECOND_COPY: Final = 0.35
_ANSWER_COPIES: Final = 3
_SHORTEST_ROUND: Final = 2
_CALLS: Final = {0: ListenHint.ANSWER, 1: ListenHint.ANSWER_NEXT}
"""What the last fragments of a round announce, by how many follow."""
_ANSWER_QOS: Final = Qos(priority=Priority.INTERACTIVE_HIGH)


class TransferLane:
    """The objects of one publisher, one after the other.

    Args:
        offer: The publisher and its topic.
        receivers: Addresses of its receivers.
        walk: Clock and nodes.
        capabilities: Capabilities of the link.
        room_bytes: Room for a fragment in a frame.
    """

    def __init__(
        self, offer: Offer, receivers: tuple[int, ...], walk: Clockwork,
        capabilities: LinkCapabilities, room_bytes: int,
    ) -> None:  # fmt: skip
        self.offer = offer
        self.receivers = receivers
        self.walk = walk
        self.room_bytes = room_bytes
        self.timing = Timing.of(
            capabilities, capabilities.mtu_bytes - room_bytes, Listening(capabilities).pause_ns
        )
        self.loss = LossEstimate()
        self._waiting: list[tuple[int, int]] = []
        self._current: Transfer | None = None

    def publish(self, payload_bytes: int) -> None:
        """Publish an object; it goes when those before it have arrived."""
        depth = self.offer.stream.qos.depth
        self._waiting.append((payload_bytes, self.walk.now))
        del self._waiting[: max(0, len(self._waiting) - depth)]
        self._next()

    def finished(self) -> None:
        """Note that all receivers have the present object."""
        self._current = None
        self._next()

    def _next(self) -> None:
        if self._current is None and self._waiting:
            payload_bytes, began_at = self._waiting.pop(0)
            self._current = Transfer(self, payload_bytes, began_at)


class Transfer:
    """One object.

    Args:
        lane: Its lane.
        payload_bytes: Its size.
        began_at: Instant of its publication, ns.
    """

    def __init__(self, lane: TransferLane, payload_bytes: int, began_at: int) -> None:
        self._lane = lane
        self._began_at = began_at
        data_bytes = lane.room_bytes - FRAGMENT_HEADER_BYTES
        size_bytes = payload_bytes + MANIFEST_BYTES + len(lane.offer.instance)
        self._layout = Layout(-(-size_bytes // data_bytes), data_bytes)
        self._sent = [0] * self._layout.blocks
        self._got = {each: [0] * self._layout.blocks for each in lane.receivers}
        self._told = {each: [0] * self._layout.blocks for each in lane.receivers}
        self._done: set[int] = set()
        self._next_source = 0
        self._asks = 0
        self._learnt = 0
        lane.walk.went(lane.offer)
        self._round()

    def _lacking(self, got: list[int], block: int) -> int:
        return max(0, self._layout.size(block) - got[block])

    def _round(self) -> None:
        """Send the next block, and the missing fragments of earlier ones."""
        lane, layout = self._lane, self._layout
        waiting = [each for each in lane.receivers if each not in self._done]
        more = self._next_source < layout.fragments
        planned: list[int] = []
        for block in range(layout.blocks):
            if not self._sent[block]:
                continue
            lacking = max(self._lacking(self._told[each], block) for each in waiting)
            if lacking:
                number = repairs_to_send(
                    [Need(lacking, lane.loss.received, lane.loss.lost)],
                    1.0 if more else self._question_frames(), BLOCK_FRAGMENTS,
                )  # fmt: skip
                planned += [block] * number
        if more:
            block = layout.block_of(self._next_source)
            planned += [block] * layout.size(block)
            self._next_source += layout.size(block)
        if len(planned) < _SHORTEST_ROUND:
            planned += [layout.blocks - 1] * (_SHORTEST_ROUND - len(planned))
        self._asks += 1
        self._send(planned, 0, self._asks)

    def _question_frames(self) -> float:
        timing, loss = self._lane.timing, self._lane.loss.loss
        answered = (1 - loss**2) * (1 - loss**_ANSWER_COPIES)
        return timing.exchange_ns / timing.slot_ns / max(0.1, answered)

    def _send(self, planned: list[int], index: int, ask: int) -> None:
        lane = self._lane
        block, left = planned[index], len(planned) - index - 1
        item = Item(
            lane.offer.stream.stream_id, lane.receivers[0] if len(lane.receivers) == 1 else 255,
            self._layout.fragment_bytes + FRAGMENT_HEADER_BYTES, lane.walk.now,
        )  # fmt: skip
        item.alone, item.voice = True, lane.offer.voice
        item.call = _CALLS.get(left, ListenHint.NONE)

        def heard(node: int, at: int) -> None:
            if node in self._got:
                self._got[node][block] += 1
                if left <= 1:
                    # The last one asks for an answer, and the one before announces that.
                    wait_ns = left * lane.timing.slot_ns
                    lane.walk.later(at + wait_ns, lambda: self._answer(node, ask))

        def ends(at: int) -> None:
            self._sent[block] += 1
            if left:
                self._send(planned, index + 1, ask)
                return
            patience_ns = lane.timing.exchange_ns
            patience_ns += (_ANSWER_COPIES - 1) * lane.timing.feedback_slot_ns
            lane.walk.later(at + patience_ns, lambda: self._unanswered(ask))

        item.heard, item.ends = heard, ends
        key = ("fragment", lane.offer.stream.stream_id, lane.offer.instance, lane.offer.voice)
        lane.walk.speaker(lane.offer.node).push(key, item, lane.offer.stream.qos, depth=1)
        lane.walk.serve(lane.offer.node)

    def _answer(self, node: int, ask: int) -> None:
        """Report missing fragments, or completion; repeat it while fragments are lost."""
        lane = self._lane
        sent = max(1, sum(self._sent))
        loss = 1 - sum(self._got[node]) / sent
        in_time = 2 * lane.timing.propagation_ns // lane.timing.feedback_slot_ns
        copies = min(1 + (loss > _FIRST_COPY) + (loss > _SECOND_COPY), 1 + in_time)
        self._reply(node, ask, copies)

    def _reply(self, node: int, ask: int, copies: int) -> None:
        lane = self._lane
        key = ("feedback", lane.offer.voice, lane.offer.stream.stream_id)
        speaker = lane.walk.speaker(node)
        if ask != self._asks or speaker.waits(key):
            return
        lacking = [b for b in range(self._layout.blocks)
                   if self._sent[b] and self._lacking(self._got[node], b)]  # fmt: skip
        size_bytes = min(FEEDBACK_BYTES, 4 + len(lacking)) if lacking else 6
        item = Item(lane.offer.stream.stream_id, lane.offer.node, size_bytes, lane.walk.now)
        item.is_control = item.for_one_node = True
        got = list(self._got[node])

        def ends(at: int) -> None:
            if copies > 1:
                gap_ns = lane.timing.gap_ns
                lane.walk.later(at + gap_ns, lambda: self._reply(node, ask, copies - 1))

        item.ends = ends
        item.heard = lambda _, at: self._answered(node, ask, got, at)
        speaker.push(key, item, _ANSWER_QOS, depth=1)
        lane.walk.serve(node)

    def _answered(self, node: int, ask: int, got: list[int], at: int) -> None:
        lane = self._lane
        if ask != self._asks:
            return
        lane.loss.learn(sum(self._sent) - self._learnt, sum(got) - sum(self._told[node]))
        self._learnt = sum(self._sent)
        self._told[node] = got
        lacks = any(self._lacking(got, block) for block in range(self._layout.blocks))
        is_complete = self._next_source == self._layout.fragments and not lacks
        if is_complete and node not in self._done:
            self._done.add(node)
            lane.walk.delivered(lane.offer, self._began_at)
        self._go_on(is_complete=self._done == set(lane.receivers))

    def _go_on(self, *, is_complete: bool) -> None:
        self._asks += 1
        if is_complete:
            self._lane.finished()
        else:
            self._round()

    def _unanswered(self, ask: int) -> None:
        if ask == self._asks and self._done != set(self._lane.receivers):
            self._round()
