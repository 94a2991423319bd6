"""Doubt: what this node knows of its former lives may be less than others have seen of them.

A journal may be damaged, or an old copy of it was put back. The node lives on all the same, in a
new epoch, with what is right in it; but of what it has done lately it knows nothing, and must not
do it a second time because it comes again. So a served call or goal that may be older than this
life, since its client repeats it for no longer than its time-out, is answered as *unknown*, which
it is, and not begun. What this node orders, or is ordered to do at once, is not held up: orders
carry their age, and do no harm twice.

The store finds most of this out by itself, and says so by an entry; subscribers find out the rest
(`zacoustic.core.arq.sending`), and it is told in the same way.
"""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.journal import DOUBT_KEY, JournalPort
from zacoustic.core.streams import StreamTable
from zacoustic.core.streamspecs import ActionSpec, ServiceSpec

_LEAST_NS: Final = seconds_to_ns(60)


class JournalDoubted(msgspec.Struct, frozen=True, kw_only=True):
    """The journal may be less than what was written last: it is damaged, or was put back.

    The node has begun anew with what is right in it. What came before, and whose outcome it does
    not know, it does not do again: see `zacoustic.core.doubt`.
    """

    reason: str
    """What was found, and by whom, one line."""


class Doubt:
    """Whether the journal of one life is in doubt, and what is refused for that.

    Args:
        address: Address of the node.
        table: Its streams.
        stored: What the journal had.
        journal: Forgets the doubt when it does not matter any more.
        emit: Takes events.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        stored: Mapping[str, bytes],
        journal: JournalPort,
        emit: Callable[[JournalDoubted], None],
    ) -> None:
        self._address = address
        self._table = table
        self._journal = journal
        self._emit = emit
        self.reason = stored.get(DOUBT_KEY, b"").decode(errors="replace")
        """Why it is in doubt, one line, for the whole life; empty: it is not."""
        self._is_stored = bool(self.reason)
        self._began_at: int | None = None
        if self.reason:
            emit(JournalDoubted(reason=self.reason))

    def link_up(self, now: int) -> None:
        """The link is up: from now on what others repeat is heard."""
        if self._began_at is None:
            self._began_at = now

    def covers(self, timeout_s: float, now: int) -> bool:
        """Tell whether what comes now may be older than this life, and done by one before.

        Args:
            timeout_s: For how long its sender repeats it, s.
            now: The instant.
        """
        began_at = now if self._began_at is None else self._began_at
        return self._is_stored and now < began_at + seconds_to_ns(timeout_s)

    def told(self, reason: str) -> None:
        """Somebody else has shown that this node has forgotten something; told once a life."""
        if not self.reason:
            self.reason = reason
        self._emit(JournalDoubted(reason=reason))

    def settle(self, now: int) -> None:
        """Forget the doubt in the journal when nothing from before this life is repeated."""
        began_at = now if self._began_at is None else self._began_at
        if self._is_stored and now >= began_at + self._longest_ns:
            self._is_stored = False
            self._journal.write(DOUBT_KEY, None)

    @property
    def _longest_ns(self) -> int:
        timeouts = (
            seconds_to_ns(stream.spec.timeout_s)
            for stream in self._table
            if isinstance(stream.spec, ServiceSpec | ActionSpec)
            and stream.spec.server == self._address
        )
        return max(timeouts, default=0) + _LEAST_NS
