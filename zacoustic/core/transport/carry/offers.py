"""What a node offers to others for the next hop.

A node that was heard lately gets several samples and answers at once. To one that was not, a node
calls out: it offers one of them, for it cannot know when the other comes into reach. It calls out
to one node at a time, in turn, so that a mooring with many custodians makes no more sound than one
with a single custodian, and many moorings leave the water to those who have met somebody. Each turn
begins with a new frame, so turns become longer with the silence, as all tries do
(`zacoustic.core.base.allowance`).
"""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from zacoustic.core.base.allowance import LONGEST_NS
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.transport.carry.custody import Offered
from zacoustic.errors import LocalError

MOST_OFFERED: Final = 16
"""How much is offered at once to a node that is heard. To another one it is one sample or answer:
whether that arrives tells the same, and each new one would be sent soon."""
_RETRY_NS: Final = 60 * NS_PER_S
_LEAST_TURN_NS: Final = 30 * NS_PER_S
"""A silent node is sent to about as often; a shorter turn could pass without a frame."""
_TURNS: Final = 2
"""How often each node is called out to in the time after which it counts as out of reach."""
_PARTS_OF_SILENCE: Final = 16
"""A turn is at least this part, 1/16, of the time in which nobody of those nodes was heard, down to
a power of two of the shortest turn: nodes that call out together then take their turns together."""

Send = Callable[[int, bytes, int], int]
"""Offers a message to a node, at an instant; returns the delivery id of the hop."""
Withdraw = Callable[[int, int], bool]
"""Ends a hop by its delivery id, at an instant."""


class Wanted(msgspec.Struct, frozen=True):
    """Something, and the nodes that should get it."""

    offered: Offered
    targets: Sequence[int]
    """Addresses of the nodes."""
    message: Callable[[int], bytes]
    """Returns it as a node gets it."""


class Offers:
    """What one node offers.

    Args:
        address: Its address.
        send: Offers a message to a node.
        withdraw: Ends such an offer.
    """

    def __init__(self, address: int, send: Send, withdraw: Withdraw) -> None:
        self._address = address
        self._send = send
        self._withdraw = withdraw
        self._hops: dict[int, tuple[Offered, int]] = {}
        """Delivery id of a hop → what is offered, to whom."""
        self._called: dict[int, Offered] = {}
        """What was offered to a node that was not heard."""

    def review(
        self,
        all_wanted: Sequence[Wanted],
        is_heard: Callable[[int], bool],
        silence_ns: Callable[[int], int],
        after_ns: int,
        now: int,
    ) -> list[int]:
        """Offer everything to whom it should be offered, and to nobody else.

        Args:
            all_wanted: What should be offered, the most urgent first.
            is_heard: Returns whether a node was heard lately.
            silence_ns: Returns for how long a node was not heard, ns.
            after_ns: How long a node may be silent before it counts as out of reach, ns.
            now: The instant.

        Returns:
            When to review it again, ns.
        """
        silent = sorted({to for each in all_wanted for to in each.targets if not is_heard(to)})
        shortest_ns = min(map(silence_ns, silent), default=0)
        turn, ends_at = self._turn(silent, shortest_ns, after_ns, now)
        for receiver, offered in list(self._called.items()):
            if is_heard(receiver):
                del self._called[receiver]
            elif receiver != turn:
                self._withdraw_one(offered, receiver, now)
        again = [ends_at] if len(silent) > 1 else []
        taken = Counter[int]()
        for wanted in all_wanted:
            offers = wanted.offered.offers
            for receiver in [each for each in offers if each not in wanted.targets]:
                self._withdraw_one(wanted.offered, receiver, now)
            for receiver in wanted.targets:
                # What is offered stays so, heard or not: its receiver may hold it, and offered
                # anew it would come after those behind it.
                taken[receiver] += 1
                has_room = taken[receiver] <= (MOST_OFFERED if is_heard(receiver) else 1)
                if not has_room or receiver in offers or receiver in wanted.offered.refused:
                    continue
                if not is_heard(receiver) and receiver != turn:
                    continue
                try:
                    hop = self._send(receiver, wanted.message(receiver), now)
                except LocalError:  # too many large samples are under way
                    again.append(now + _RETRY_NS)
                    continue
                offers[receiver] = hop
                self._hops[hop] = wanted.offered, receiver
                if not is_heard(receiver):
                    self._called[receiver] = wanted.offered
        return again

    def ended(self, hop: int) -> tuple[Offered, int] | None:
        """Forget a hop that has ended; return what was offered, to whom, or None."""
        found = self._hops.pop(hop, None)
        if found is not None:
            offered, receiver = found
            del offered.offers[receiver]
            self._forget_call(offered, receiver)
        return found

    def withdraw(self, offered: Offered, now: int) -> None:
        """Withdraw something from all nodes."""
        for receiver in list(offered.offers):
            self._withdraw_one(offered, receiver, now)

    # Below the methods above

    def _turn(
        self, silent: Sequence[int], silence_ns: int, after_ns: int, now: int
    ) -> tuple[int | None, int]:
        """Return whom to call out to now, and when that ends, ns."""
        if not silent:
            return None, now
        turn_ns = max(_LEAST_TURN_NS, after_ns // (_TURNS * len(silent)))
        while turn_ns * _PARTS_OF_SILENCE < silence_ns and turn_ns < LONGEST_NS:
            turn_ns *= 2
        turns = now // turn_ns
        # Many nodes begin at the same time; each calls out to another one first.
        return silent[(turns + self._address) % len(silent)], (turns + 1) * turn_ns

    def _withdraw_one(self, offered: Offered, receiver: int, now: int) -> None:
        hop = offered.offers.pop(receiver)
        self._hops.pop(hop, None)
        self._forget_call(offered, receiver)
        self._withdraw(hop, now)

    def _forget_call(self, offered: Offered, receiver: int) -> None:
        if self._called.get(receiver) is offered:
            del self._called[receiver]
