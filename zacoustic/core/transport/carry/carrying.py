"""A node's part in carried topics: what it publishes, takes, offers and hands on."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.carry.answers import Answers, CarryAnswer
from zacoustic.core.transport.carry.arrivals import Arrivals
from zacoustic.core.transport.carry.counts import Claim, Counts, Place
from zacoustic.core.transport.carry.custody import Custody, Held
from zacoustic.core.transport.carry.offers import Offers, Send, Wanted, Withdraw
from zacoustic.core.transport.carry.reach import Reach
from zacoustic.core.transport.carry.status import CarryStatus, streams_of
from zacoustic.core.transport.deliveries import (
    CustodyChanged,
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    SampleReceived,
)
from zacoustic.core.transport.outcomes import Outcomes
from zacoustic.core.transport.publication import EncodedSample
from zacoustic.core.transport.reliable.sending.keeping import OTHER_STREAM
from zacoustic.core.wire.carry import (
    DIGEST_BYTES,
    MINUTE_S,
    Bundle,
    CarryRefusal,
    Envelope,
    Receipt,
    decode,
    encode_answer,
    encode_envelope,
)
from zacoustic.core.wire.frame import Control
from zacoustic.errors import JournalUnavailableError, LocalError, UnknownStreamError

LEAST_FULL_S: Final = 600.0
"""How long a custodian that has no room is not asked again, s, or longer: `Carry.after_s`."""
MOST_CARRIED: Final = 16384
"""How many samples of others a node keeps, however small they are."""
MOST_ANSWERS: Final = 1024
"""How many receipts and refusals wait at a node; the oldest give way."""
_LEAST_LIFE_NS: Final = seconds_to_ns(MINUTE_S)
"""An envelope tells lives in minutes: a custodian takes nothing with less to live than one, ns."""
_AT_ONCE: Final = 0
"""An instant that has always passed."""


class _Own:
    """A sample of this node, until all its subscribers have it."""

    def __init__(self, stream_id: int, instance: Instance) -> None:
        self.stream_id = stream_id
        self.instance = instance
        self.held: list[Held] = []
        """One for each subscriber that is not known to have it."""
        self.refused: list[int] = []
        """Subscribers that define its topic in another way."""


class Carrying:
    """The carried topics of one node on one link.

    Args:
        context: What the components of its engine share.
        max_bytes: How much it keeps for other nodes, bytes.
        hand_on: Takes each sample for this node, and the instant.
        next_delivery_id: Returns a delivery id that was never used before.
        send: Offers a message to a node.
        withdraw: Ends such an offer.
        outcomes: Tells the ends of own samples.
    """

    def __init__(
        self,
        context: Context,
        max_bytes: int,
        hand_on: Callable[[SampleReceived, int], None],
        next_delivery_id: Callable[[], int],
        send: Send,
        withdraw: Withdraw,
        outcomes: Outcomes,
    ) -> None:
        self._address = context.address
        self._table = context.table
        self._timers = context.timers
        self._journal = context.journal
        self._doubt = context.doubt
        self._stats = context.stats
        self._peers, self._handshake = context.peers, context.handshake
        self._emit: Callable[[Any], None] = context.emit
        self._outcomes = outcomes
        self._max_bytes = max_bytes
        self._next_delivery_id = next_delivery_id
        self._offers = Offers(context.address, send, withdraw)
        self._carries: dict[int, Carry] = {}
        self._wildcards: dict[int, int] = {}
        for stream in context.table:
            self.declared(stream)
        self._custody = Custody(context.journal, context.stored)
        self._answers = Answers(context.journal)
        self._counts = Counts(context.generators.of("carry"))
        self._arrivals = Arrivals(
            context.table, context.journal, hand_on,
            lambda: bool(context.doubt.reason), context.stats.drop,
        )  # fmt: skip
        self._reach = Reach(context.address, self._carries)
        self._own: dict[int, _Own] = {}
        self._obsolete: list[int] = []
        """Own samples from before the restart whose topic is defined in another way now."""
        self._ended: list[DeliveryEnded] = []
        """Hops that have ended since the last look at the offers."""
        self._is_due = False
        self._instants: list[int] = []
        """When to look at the offers again, ns."""
        self._refused = self._expired = 0
        context.reception.read.connect(self._heard)
        context.peers.forgotten.connect(self._forgotten)

    def __contains__(self, stream_id: int) -> bool:
        """Return whether a topic is carried."""
        return stream_id in self._carries

    def declared(self, stream: Stream) -> None:
        """Note a stream that the table has from now on."""
        if isinstance(stream.spec, TopicSpec) and stream.spec.carry is not None:
            self._carries[stream.stream_id] = stream.spec.carry
            self._wildcards[stream.stream_id] = len(stream.keys.wildcards)

    @property
    def _after_ns(self) -> int:
        """After this time without a frame the first topic takes a node for out of reach, ns."""
        return seconds_to_ns(min(each.after_s for each in self._carries.values()))

    # Life cycle of the engine

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore everything from before the restart."""
        self._arrivals.recover(stored)
        self._answers.recover(stored)
        for held in self._custody.recover(stored):
            bundle = held.envelope.bundle
            if held.delivery_id is None:
                if bundle.stream_id not in self._carries:
                    self._custody.drop(held)
                continue
            if self._outcomes.has(held.delivery_id):
                self._custody.drop(held)
                continue
            self._counts.used(bundle.stream_id, bundle.instance, bundle.lineage)
            own = _Own(bundle.stream_id, bundle.instance)
            self._own.setdefault(held.delivery_id, own).held.append(held)
        self._obsolete += [each for each, own in self._own.items() if not self._is_same(own)]

    def link_up(self, now: int) -> None:
        """Offer what is kept: the link is up."""
        self._reach.begin(now)
        self._custody.begin(now)
        self._answers.begin(now)
        for delivery_id in self._obsolete:
            self._end(delivery_id, DeliveryOutcome.CANCELLED, now, OTHER_STREAM)
        self._obsolete.clear()
        self._changed()

    # For the application

    def publish(self, stream: Stream, sample: EncodedSample, now: int) -> int:
        """Publish a sample; return its delivery id.

        Raises:
            JournalUnavailableError: The journal cannot be written.
            LocalError: No other node is listed that could receive it.
        """
        if self._journal.failure:
            raise JournalUnavailableError(
                f"{stream.name}: not accepted: the journal cannot be written: "
                f"{self._journal.failure}",
                hint="what is accepted has to survive a restart",
            )
        receivers = [
            each
            for each in stream.receivers(sample.instance, self._table.nodes)
            if each != self._address
        ]
        if not receivers:
            raise LocalError(
                f"{stream.name}: nobody is listed who could receive it",
                hint="list another node among the subscribers of the stream",
            )
        delivery_id = self._next_delivery_id()
        carry = self._carries[stream.stream_id]
        place = self._counts.take(stream.stream_id, sample.instance)
        ends_at = now + seconds_to_ns(carry.expires_s)
        if sample.expires_at is not None:
            ends_at = min(ends_at, sample.expires_at)
        own = self._own[delivery_id] = _Own(stream.stream_id, sample.instance)
        for receiver in receivers:
            bundle = Bundle(
                self._address, receiver, stream.stream_id, sample.instance, place.lineage
            )
            life_s = ns_to_seconds(ends_at - now)
            envelope = _envelope(stream, sample, bundle, place.number, life_s)
            is_last = receiver == receivers[-1]
            then = partial(self._stored, delivery_id) if is_last else _nothing
            own.held.append(
                self._custody.keep(envelope, ends_at, now, delivery_id=delivery_id, then=then)
            )
        self._supersede(stream, sample, now)
        self._changed()
        return delivery_id

    def cancel(self, delivery_id: int, now: int) -> bool:
        """Cancel a sample; return False when it is not under way."""
        if delivery_id not in self._own:
            return False
        self._end(delivery_id, DeliveryOutcome.CANCELLED, now)
        return True

    def delivering(self, stream_id: int) -> int:
        """Return how many samples of a topic have not ended."""
        return sum(own.stream_id == stream_id for own in self._own.values())

    def is_delivering(self, delivery_id: int) -> bool:
        """Return whether a sample has not ended."""
        return delivery_id in self._own

    @property
    def status(self) -> CarryStatus:
        """What is kept for the next hop."""
        own = [held for each in self._own.values() for held in each.held]
        return CarryStatus(
            own=len(self._own),
            in_custody=sum(held.custodian is not None for held in own),
            carried=self._custody.carried,
            carried_bytes=self._custody.carried_bytes,
            max_bytes=self._max_bytes,
            refused=self._refused,
            expired=self._expired,
            streams=tuple(streams_of(self._custody, is_dated=self._custody.is_dated)),
        )

    # For the hops

    def take(self, hop: SampleReceived, now: int) -> None:
        """Take what another node offers, which its transport has journalled."""
        if hop.instance != (self._address,) or not isinstance(hop.value, bytes):
            return
        message = decode(hop.value, hop.source, self._address, self._wildcards)
        reason = "payload" if message is None else self._fault(message, hop.source)
        if message is None or reason is not None:
            self._stats.drop(reason or "payload")
        elif isinstance(message, Envelope):
            self._take_sample(message, hop, now)
        elif message.bundle.origin != self._address:
            self._pass_on(message, now)
        elif isinstance(message, Receipt):
            self._receipt(message, now)
        else:
            self._refused_by(message, hop.source, now)

    def told(self, ended: DeliveryEnded) -> None:
        """Take the end of a hop."""
        self._ended.append(ended)
        self._changed()

    # Below the methods above

    def _stored(self, delivery_id: int, now: int) -> None:
        own = self._own.get(delivery_id)
        if own is not None:
            self._emit(DeliveryStored(delivery_id=delivery_id, stream_id=own.stream_id))
            self._changed()

    def _supersede(self, stream: Stream, sample: EncodedSample, now: int) -> None:
        """End the oldest samples of a key, beyond its depth."""
        of_key = [
            delivery_id
            for delivery_id, own in self._own.items()
            if (own.stream_id, own.instance) == (stream.stream_id, sample.instance)
        ]
        for delivery_id in of_key[: -stream.qos.depth]:
            self._end(delivery_id, DeliveryOutcome.SUPERSEDED, now)

    def _fault(self, message: Envelope | Receipt | CarryRefusal, sender: int) -> str | None:
        """Return why the table does not allow a message, one word, or None."""
        bundle = message.bundle
        stream = self._table.by_id(bundle.stream_id)
        carry = self._carries[bundle.stream_id]
        ends = (bundle.origin, bundle.destination)
        if not stream.may_publish(bundle.origin) or not stream.may_subscribe(bundle.destination):
            return "not_publisher"
        try:
            stream.keys.key(bundle.origin, bundle.instance)
        except UnknownStreamError:
            return "payload"
        if bundle.origin == bundle.destination:
            return "not_publisher"
        parties = {*ends, *carry.by}
        if sender not in parties or self._address not in parties:
            return "not_custodian"
        return None

    def _take_sample(self, envelope: Envelope, hop: SampleReceived, now: int) -> None:
        bundle = envelope.bundle
        self._answers.came_by(bundle, hop.source)
        if bundle.destination == self._address:
            stream = self._table.by_id(bundle.stream_id)
            if envelope.digest != stream.digest[:DIGEST_BYTES]:
                self._stats.drop("differs")
                self._answer(CarryRefusal(bundle, envelope.number, is_final=True), now)
                return
            expected, is_new = self._arrivals.take(envelope, hop, now)
            self._changed()
            # Of a new one its publisher learns by the hop, if that comes from it.
            if not (is_new and self._is_told_by_hop(hop.source, bundle)):
                self._answer(Receipt(bundle, expected), now)
            return
        if bundle.origin == self._address or self._custody.find(bundle, envelope.number):
            return
        size_bytes = envelope.size_bytes
        has_room = self._custody.carried < MOST_CARRIED and (
            self._custody.carried_bytes + size_bytes <= self._max_bytes
        )
        if not has_room or envelope.life_s <= 0:
            self._refused += 1
            self._answer(CarryRefusal(bundle, envelope.number), now)
            return
        ends_at = now + seconds_to_ns(envelope.life_s)
        kept = msgspec.structs.replace(envelope, hops=max(0, envelope.hops - 1))
        self._custody.keep(kept, ends_at, now, then=lambda at: self._changed())

    def _receipt(self, receipt: Receipt, now: int) -> None:
        """Take a receipt of an own count."""
        bundle, number = receipt.bundle, receipt.number
        claim = Place(bundle.lineage, number)
        verdict = self._counts.judge(bundle.stream_id, bundle.instance, claim)
        if verdict is Claim.COUNT_IS_WRONG:
            self._begin_anew(bundle, now)
        elif verdict is Claim.IMPOSSIBLE:
            self._take_back(bundle, now)
        if verdict is not Claim.POSSIBLE:
            return
        for held in self._custody:
            is_own = held.delivery_id is not None and held.envelope.bundle == bundle
            if is_own and held.envelope.number < number:
                self._done(held, now)
        self._changed()

    def _take_back(self, bundle: Bundle, now: int) -> None:
        """Offer the samples of a count again that are in custody.

        A custodian that has passed an impossible receipt on has believed it, and dropped them.
        """
        for held in self._custody:
            custodian = held.custodian
            if custodian is None or held.envelope.bundle != bundle:
                continue
            held.custodian = None
            self._custody.write(held, now)
            self._tell(held, None, f"node {custodian} may have dropped it", now)
        self._changed()

    def _begin_anew(self, bundle: Bundle, now: int) -> None:
        """Give all samples of a key places in another count: the present one cannot be right."""
        stream_id, instance = bundle.stream_id, bundle.instance
        self._counts.begin_anew(stream_id, instance)
        for own in list(self._own.values()):
            if (own.stream_id, own.instance) != (stream_id, instance):
                continue
            place = self._counts.take(stream_id, instance)
            for held in own.held:
                self._offers.withdraw(held, now)
                other = msgspec.structs.replace(held.envelope.bundle, lineage=place.lineage)
                self._custody.renumber(held, other, place.number, now)
        self._changed()

    def _refused_by(self, refusal: CarryRefusal, source: int, now: int) -> None:
        """Take the word of a custodian, or of the subscriber, that it does not take a sample."""
        held = self._custody.find(refusal.bundle, refusal.number)
        if held is None or held.delivery_id is None:
            return
        if refusal.is_final:
            self._own[held.delivery_id].refused.append(refusal.bundle.destination)
            self._done(held, now)
            return
        carry = self._carries[refusal.bundle.stream_id]
        custodian = held.custodian if held.custodian is not None else source
        self._reach.is_full(custodian, now + seconds_to_ns(max(carry.after_s, LEAST_FULL_S)))
        held.custodian = None
        self._offers.withdraw(held, now)
        self._custody.write(held, now)
        self._tell(held, None, f"node {custodian} has no room for it", now)
        self._changed()

    def _pass_on(self, answer: Receipt | CarryRefusal, now: int) -> None:
        """Take an answer for another node along, and drop what it makes needless."""
        if isinstance(answer, Receipt):
            if answer.bundle.destination == self._address:
                return  # this node alone knows what it has
            for held in self._custody:
                if held.envelope.bundle == answer.bundle and held.envelope.number < answer.number:
                    self._drop(held, now)
        self._answer(answer, now)

    def _answer(self, content: Receipt | CarryRefusal, now: int) -> None:
        older = self._answers.find(content)
        if older is not None and older.content.number >= content.number:
            return
        if older is not None:
            self._offers.withdraw(older, now)
        elif len(self._answers) >= MOST_ANSWERS:
            self._drop_answer(next(iter(self._answers)), now)
        carry = self._carries[content.bundle.stream_id]
        self._answers.keep(content, seconds_to_ns(carry.expires_s), now)
        self._changed()

    def _hop_ended(self, ended: DeliveryEnded, now: int) -> None:
        found = self._offers.ended(ended.delivery_id)
        if found is None:
            return
        offered, receiver = found
        if ended.outcome is not DeliveryOutcome.DELIVERED:
            offered.refused.add(receiver)
        elif isinstance(offered, CarryAnswer):
            bundle = offered.content.bundle
            offered.refused.add(receiver)  # it has it
            if receiver in (bundle.origin, self._answers.way(bundle)):
                self._drop_answer(offered, now)
        elif isinstance(offered, Held):
            self._given(offered, receiver, now)

    def _given(self, held: Held, receiver: int, now: int) -> None:
        """Note that another node has taken a sample and journalled it."""
        bundle = held.envelope.bundle
        if receiver == bundle.destination:
            held.refused.add(receiver)  # it has answered, or will
            if held.delivery_id is None or self._is_told_by_hop(receiver, bundle):
                self._done(held, now)
        elif held.delivery_id is None:
            self._drop(held, now)
        else:
            held.custodian = receiver
            self._offers.withdraw(held, now)
            self._custody.write(held, now)
            self._tell(held, receiver, "", now)

    def _tell(self, held: Held, custodian: int | None, detail: str, now: int) -> None:
        assert held.delivery_id is not None
        self._emit(
            CustodyChanged(
                delivery_id=held.delivery_id,
                stream_id=held.envelope.bundle.stream_id,
                subscriber=held.envelope.bundle.destination,
                custodian=custodian,
                changed_at=now,
                detail=detail,
            )
        )

    def _done(self, held: Held, now: int) -> None:
        """Note that the subscriber of a sample has it."""
        self._drop(held, now)
        own = None if held.delivery_id is None else self._own.get(held.delivery_id)
        if own is None or held.delivery_id is None:
            return
        own.held = [each for each in own.held if each is not held]
        if not own.held:
            refused = DeliveryOutcome.REFUSED if own.refused else DeliveryOutcome.DELIVERED
            self._end(held.delivery_id, refused, now, OTHER_STREAM if own.refused else "")

    def _is_told_by_hop(self, other_end: int, bundle: Bundle) -> bool:
        """Return whether a sample is understood, since it came straight and both ends agree."""
        is_straight = {other_end, self._address} == {bundle.origin, bundle.destination}
        peer = self._peers.get(other_end)
        return is_straight and peer is not None and peer.shares(self._handshake.digest)

    def _is_same(self, own: _Own) -> bool:
        """Return whether the topic of an own sample is still what it was."""
        if own.stream_id not in self._carries:
            return False
        digest = self._table.by_id(own.stream_id).digest[:DIGEST_BYTES]
        return own.held[0].envelope.digest == digest

    def _end(self, delivery_id: int, outcome: DeliveryOutcome, now: int, detail: str = "") -> None:
        """End an own sample."""
        own = self._own.pop(delivery_id)
        custodians = sorted({each.custodian for each in own.held if each.custodian is not None})
        missing = {each.envelope.bundle.destination for each in own.held} | set(own.refused)
        if custodians and not detail:
            detail = f"in custody of {', '.join(map(str, custodians))}"
        self._outcomes.tell(
            DeliveryEnded(
                delivery_id=delivery_id,
                stream_id=own.stream_id,
                outcome=outcome,
                missing=tuple(sorted(missing)),
                ended_at=now,
                detail=detail,
            )
        )
        for held in own.held:
            self._drop(held, now)
        self._changed()

    def _expire(self, held: Held, now: int) -> None:
        if held.delivery_id is None:
            self._expired += 1
            self._drop(held, now)
        elif held.delivery_id in self._own:
            self._end(held.delivery_id, DeliveryOutcome.EXPIRED, now)

    def _drop(self, held: Held, now: int) -> None:
        self._offers.withdraw(held, now)
        self._custody.drop(held)
        self._changed()

    def _drop_answer(self, answer: CarryAnswer, now: int) -> None:
        self._offers.withdraw(answer, now)
        self._answers.drop(answer)

    # Offers

    def _heard(self, source: int, now: int) -> None:
        """Look at the offers if a node is in reach that was not."""
        before = self._reach.heard(source, now)
        if before is None or now - before >= self._after_ns:
            self._changed()

    def _forgotten(self, address: int, now: int) -> None:
        self._reach.forget(address)
        self._arrivals.forget(address)
        self._answers.forget(address)

    def _changed(self) -> None:
        """Look at the offers again, at once."""
        self._is_due = True
        self._timers.changed((Due.CARRY,), self._due_at, self._review)

    def _due_at(self) -> int | None:
        if self._is_due:
            return _AT_ONCE
        return min(self._instants, default=None)

    def _review(self, now: int) -> None:
        """End what has expired, and offer everything to whom it should be offered."""
        for ended in self._ended:
            self._hop_ended(ended, now)
        self._ended.clear()
        for held in self._custody:
            if held.ends_at <= now:
                self._expire(held, now)
        self._instants = [held.ends_at for held in self._custody]
        self._give_up_gaps(now)
        ends: set[tuple[int, int]] = set()
        wanted = [*self._wanted_answers(ends, now), *self._wanted_samples(ends, now)]
        is_heard = partial(self._reach.is_present, now=now)
        silence_ns = partial(self._reach.silence_ns, now=now)
        self._instants += self._offers.review(wanted, is_heard, silence_ns, self._after_ns, now)
        self._instants += [each.ends_at for each in self._answers if each.ends_at is not None]
        for stream_id, end in ends:
            carry = self._carries[stream_id]
            self._instants += self._reach.changes_at((end, *carry.by), carry, now)
        self._is_due = False
        self._timers.changed((Due.CARRY,), self._due_at, self._review)

    def _wanted_answers(self, ends: set[tuple[int, int]], now: int) -> Iterator[Wanted]:
        """Yield the answers and who should get them; add the publishers of their topics."""
        for answer in self._answers:
            bundle = answer.content.bundle
            carry = self._carries.get(bundle.stream_id)
            if carry is None or (answer.ends_at is not None and answer.ends_at <= now):
                self._drop_answer(answer, now)
                continue
            ends.add((bundle.stream_id, bundle.origin))
            way = self._answers.way(bundle)
            targets = self._reach.for_answer(bundle, way, carry, now)
            yield Wanted(answer, targets, partial(_answer_for, answer))

    def _wanted_samples(self, ends: set[tuple[int, int]], now: int) -> Iterator[Wanted]:
        """Yield the samples and who should get them; add the subscribers of their topics."""
        for held in self._in_order():
            bundle = held.envelope.bundle
            if held.is_stored and bundle.stream_id in self._carries:
                ends.add((bundle.stream_id, bundle.destination))
                targets = self._reach.for_sample(held, self._carries[bundle.stream_id], now)
                if held.ends_at - now < _LEAST_LIFE_NS:
                    targets = [each for each in targets if each == bundle.destination]
                yield Wanted(held, targets, partial(self._sample_for, held, now))

    def _give_up_gaps(self, now: int) -> None:
        """Deliver what has waited for others as long as any sample is carried."""
        for bundle in self._arrivals:
            carry = self._carries.get(bundle.stream_id)
            if carry is None:
                continue
            until = self._arrivals.waits_until(bundle, seconds_to_ns(carry.expires_s), now)
            if until is not None and until <= now:
                self._answer(Receipt(bundle, self._arrivals.give_up(bundle, now)), now)
            elif until is not None:
                self._instants.append(until)

    def _in_order(self) -> list[Held]:
        """Return the samples, the most urgent first, each count as a whole and in its order.

        They may have come in another one: a hop that is cut off by a restart has gaps.
        """
        firsts: dict[Bundle, int] = {}
        for held in self._custody:
            firsts.setdefault(held.envelope.bundle, held.number)

        def rank(held: Held) -> tuple[int, int, int]:
            bundle = held.envelope.bundle
            priority = self._table.by_id(bundle.stream_id).qos.priority.value
            return priority, firsts[bundle], held.envelope.number

        return sorted(self._custody, key=rank)

    def _sample_for(self, held: Held, now: int, receiver: int) -> bytes:
        """Return a sample as a node gets it."""
        envelope = held.envelope
        if held.delivery_id is not None:
            floor = min(
                each.envelope.number
                for each in self._custody
                if each.envelope.bundle == envelope.bundle
            )
            envelope = msgspec.structs.replace(envelope, floor=floor)
        life_s = ns_to_seconds(held.ends_at - now)
        envelope = msgspec.structs.replace(envelope, life_s=life_s)
        return encode_envelope(envelope, self._address, receiver)


def _answer_for(answer: CarryAnswer, receiver: int) -> bytes:
    """Return an answer as any node gets it."""
    return encode_answer(answer.content)


def _envelope(
    stream: Stream, sample: EncodedSample, bundle: Bundle, number: int, life_s: float
) -> Envelope:
    """Return a sample as it is kept."""
    return Envelope(
        bundle=bundle,
        number=number,
        floor=None,
        digest=stream.digest[:DIGEST_BYTES],
        life_s=life_s,
        deleted=sample.prefix[:1] == bytes((Control.DELETE,)),
        encoding=sample.encoding,
        payload=sample.payload,
    )


def _nothing(now: int) -> None:
    """Take the end of a journal write that nobody waits for."""
