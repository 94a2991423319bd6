"""The reply budget: how much of the time each other node can make this node transmit.

A node answers what its fleet asks: it acknowledges samples and objects, answers calls, goals and
questions about tables. A node that has been captured, or that is broken, has the key, so it could
keep the others transmitting until their batteries are empty. So a sealed node keeps an account for
each other node. The share of the passing time is paid in, up to the share of a day. The airtime of
each frame that goes because of that node is taken out, on all links together.

While an account has a debt, the replies to that other node wait in the queue, and the node raises
an alarm. All that the other node sends still has its effect: a stop stops, a cancel cancels. Two
things are dropped (drop reason ``reply_budget``), since each of them alone can ask for kilobytes:
the fragments of its objects, and its questions about tables.

Accounts are not in the journal: a restart begins with full ones.
"""

from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.schedule.airtime import AirtimeAccount

REPLY_SHARE: Final = 0.25
"""The default: more than acknowledgements take of a channel that is always busy."""
_DAY_NS: Final = 86_400 * NS_PER_S


class ReplyBudget:
    """The accounts of the other nodes.

    Args:
        share: Share of the time for each of them, above 0, at most 1; None: no limit.
        costly: Called with address and instant when a node in debt makes this one do more.
    """

    def __init__(self, share: float | None, costly: Callable[[int, int], None]) -> None:
        self._share = share
        self._costly = costly
        self._of: dict[int, AirtimeAccount] = {}

    def spend(self, address: int, airtime_ns: int, now: int) -> int:
        """Pay for a frame that goes because of a node; return when replies to it go on, ns."""
        if self._share is None:
            return now
        account = self._of.get(address)
        if account is None:
            account = self._of[address] = AirtimeAccount(self._share, saved_ns=_DAY_NS)
        account.spend(airtime_ns, now)
        even_at = account.even_at(now)
        if even_at > now:
            self._costly(address, now)
        return even_at

    def refuses(self, address: int, now: int) -> bool:
        """Return whether a node is in debt; if so, raise the alarm."""
        account = self._of.get(address)
        if account is None or account.even_at(now) == now:
            return False
        self._costly(address, now)
        return True

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget a node."""
        self._of.pop(address, None)
