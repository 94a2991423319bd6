"""Who is in reach of a node, and so to whom it offers what it holds."""

from collections.abc import Mapping, Sequence

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.streams.carry import Carry
from zacoustic.core.transport.carry.custody import Held
from zacoustic.core.wire.carry import Bundle


class Reach:
    """When this node last heard the others.

    Args:
        address: Address of this node.
        carries: Who carries each carried topic, by stream id.
    """

    def __init__(self, address: int, carries: Mapping[int, Carry]) -> None:
        self._address = address
        self._carries = carries
        self._began_at: int | None = None
        self._heard_at: dict[int, int] = {}
        self._full_until: dict[int, int] = {}

    def begin(self, now: int) -> None:
        """Note that this node hears the others from now on; later calls have no effect."""
        if self._began_at is None:
            self._began_at = now

    def heard(self, address: int, now: int) -> int | None:
        """Note that a node was heard; return when it was heard before, ns, or None."""
        before = self._heard_at.get(address)
        self._heard_at[address] = now
        return before

    def is_present(self, address: int, now: int) -> bool:
        """Return whether a node is in reach for any topic."""
        return any(self._is_heard(address, each, now) for each in self._carries.values())

    def silence_ns(self, address: int, now: int) -> int:
        """Return for how long a node was not heard, ns."""
        return now - self._since(address)

    def forget(self, address: int) -> None:
        """Forget a node."""
        self._heard_at.pop(address, None)
        self._full_until.pop(address, None)

    def is_full(self, address: int, until: int) -> None:
        """Note that a custodian has no room; ask it again from an instant on, ns."""
        self._full_until[address] = until

    def for_sample(self, held: Held, carry: Carry, now: int) -> Sequence[int]:
        """Return the nodes to which a sample is offered."""
        bundle = held.envelope.bundle
        destination = bundle.destination
        if not self._is_lost(destination, carry, now):
            return (destination,)
        if held.custodian is not None:
            return ()
        nearer = [] if held.envelope.hops == 0 else self._nearer(carry, bundle.origin)
        open_ = [
            each
            for each in nearer
            if each not in (destination, bundle.origin)
            and each not in held.refused
            and self._full_until.get(each, now) <= now
        ]
        heard = next((each for each in open_ if self._is_heard(each, carry, now)), None)
        return (destination, *open_) if heard is None else (heard,)

    def for_answer(self, bundle: Bundle, way: int | None, carry: Carry, now: int) -> Sequence[int]:
        """Return the nodes to which a receipt or refusal is offered.

        Args:
            bundle: What it is about.
            way: The node by which the samples came; None: none came here, so whoever gave the
                answer to this node did so in case it meets the publisher.
            carry: Who carries the topic.
            now: The instant.
        """
        if self._is_heard(bundle.origin, carry, now):
            return (bundle.origin,)
        if way is not None and self._is_heard(way, carry, now):
            return (way,)
        others = [each for each in self._farther(carry) if each not in (bundle.destination, way)]
        heard = [each for each in others if self._is_heard(each, carry, now)]
        if way is None:
            return heard
        # A publisher that was met once may never come again: any custodian may meet it.
        return (way, *(heard or (others if way == bundle.origin else ())))

    def changes_at(self, addresses: Sequence[int], carry: Carry, now: int) -> list[int]:
        """Return the next instants at which one of some nodes may come to count otherwise, ns."""
        after_ns = seconds_to_ns(carry.after_s)
        instants = [self._since(each) + after_ns for each in addresses]
        instants += [self._full_until[each] for each in addresses if each in self._full_until]
        return [at for at in instants if at > now]

    # Below the methods above

    def _since(self, address: int) -> int:
        return self._heard_at.get(address, self._began_at or 0)

    def _is_lost(self, address: int, carry: Carry, now: int) -> bool:
        return now - self._since(address) >= seconds_to_ns(carry.after_s)

    def _is_heard(self, address: int, carry: Carry, now: int) -> bool:
        return address in self._heard_at and not self._is_lost(address, carry, now)

    def _nearer(self, carry: Carry, origin: int) -> Sequence[int]:
        """Return the custodians that are nearer to the subscribers, the nearest first."""
        if self._address in carry.by and self._address != origin:
            return carry.by[: carry.by.index(self._address)]
        return carry.by

    def _farther(self, carry: Carry) -> Sequence[int]:
        """Return the custodians that are nearer to the publisher, the nearest to it first."""
        if self._address in carry.by:
            return carry.by[carry.by.index(self._address) + 1 :][::-1]
        return carry.by[::-1]
