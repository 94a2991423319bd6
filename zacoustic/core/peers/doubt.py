"""Doubt: what this node knows of its former lives may be less than others have seen of them.

A journal may be damaged, or an old copy of it was put back. The node lives on all the same, in a
new epoch, with what is right in it; but of what it has done lately it knows nothing, and must not
do it a second time because it comes again. So a served call or goal that may be older than this
life, since its client repeats it for no longer than its time-out, is answered as *unknown*, which
it is, and not begun. What this node commands, or is commanded to do at once, is not held up:
commands carry their age, and do no harm twice.

The store finds most of this out by itself, and says so by an entry; subscribers find out the rest
(`zacoustic.core.transport.reliable.sending.contradictions`), and it is told in the same way. What
they say may be forged, or late, and is believed when it is said again. Until then nothing is
refused for it and nothing is
begun: a call or goal that may be older than this life is dropped, and its client repeats it.
"""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.base.journal import DOUBT_KEY, JournalPort
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import StreamTable

_LEAST_NS: Final = seconds_to_ns(60)


class JournalDoubted(msgspec.Struct, frozen=True, kw_only=True):
    """The journal may be less than what was written last: it is damaged, or was put back.

    The node has begun anew with what is right in it. What came before, and whose outcome it does
    not know, it does not do again: see `zacoustic.core.peers.doubt`.
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
        self._suspected_until = 0
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
        return self._is_stored and self._may_be_older(timeout_s, now)

    def suspends(self, timeout_s: float, now: int) -> bool:
        """Tell whether that may soon have to be said, so that what comes now is not to be begun.

        Args:
            timeout_s: For how long its sender repeats it, s.
            now: The instant.
        """
        is_suspected = now < self._suspected_until and not self._is_stored
        return is_suspected and self._may_be_older(timeout_s, now)

    def suspect(self, until: int) -> None:
        """Somebody says what cannot be; nothing that may be older than this life begins before."""
        self._suspected_until = max(self._suspected_until, until)

    def told(self, reason: str, now: int) -> None:
        """Somebody else has shown that this node has forgotten something.

        It has, from the beginning of this life: what may be older is refused as if the store had
        said so, in the next life as well.
        """
        if not self.reason:
            self.reason = reason
        if not self._is_stored and self._may_be_older(ns_to_seconds(self._longest_ns), now):
            self._is_stored = True
            self._journal.write(DOUBT_KEY, self.reason.encode())
        self._emit(JournalDoubted(reason=reason))

    def settle(self, now: int) -> None:
        """Forget the doubt in the journal when nothing from before this life is repeated."""
        began_at = now if self._began_at is None else self._began_at
        if self._is_stored and now >= began_at + self._longest_ns:
            self._is_stored = False
            self._journal.write(DOUBT_KEY, None)

    def _may_be_older(self, timeout_s: float, now: int) -> bool:
        began_at = now if self._began_at is None else self._began_at
        return now < began_at + seconds_to_ns(timeout_s)

    @property
    def _longest_ns(self) -> int:
        timeouts = (
            seconds_to_ns(stream.spec.timeout_s)
            for stream in self._table
            if isinstance(stream.spec, ServiceSpec | ActionSpec)
            and stream.spec.server == self._address
        )
        return max(timeouts, default=0) + _LEAST_NS
