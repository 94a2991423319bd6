"""Doubt: this node may know less of its former lives than others have seen of them.

A journal may be damaged, or an old copy of it may have been put back. The node goes on all the
same, in a new epoch, with whatever is right in it. But it does not know what it did last, and must
not do it again when it arrives again. A client repeats a call or goal for no longer than its
time-out. Within that time after the start, a call or goal may be older than this life: the node
answers that its outcome is *unknown*, which is true, and does not begin it. Remote commands are not
held up, neither those that it gives nor those that it receives: they carry their age and do no harm
twice.

The store detects most of this by itself and leaves an entry. Subscribers detect the rest
(`zacoustic.core.transport.reliable.sending.contradictions`); the node is told in the same way. What
they report may be forged or late, so it is believed when it comes a second time. Until then the
node refuses nothing and begins nothing: it drops a call or goal that may be older than this life,
and the client repeats it.
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
    """The journal may lack the last writes: it is damaged, or an old copy was put back.

    The node goes on with what is right in it. It does not repeat what came before and whose outcome
    it does not know: see `zacoustic.core.peers.doubt`.
    """

    reason: str
    """What was found, and who found it, one line."""


class Doubt:
    """Whether the journal of one life is in doubt, and what is refused because of that.

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
        """The link is up: from now on repetitions of others are heard."""
        if self._began_at is None:
            self._began_at = now

    def covers(self, timeout_s: float, now: int) -> bool:
        """Tell whether what arrives now may be older than this life, and done by a former one.

        Args:
            timeout_s: For how long its sender repeats it, s.
            now: The instant.
        """
        return self._is_stored and self._may_be_older(timeout_s, now)

    def suspends(self, timeout_s: float, now: int) -> bool:
        """Tell whether a suspicion is open that would cover what arrives now: it must not begin.

        Args:
            timeout_s: For how long its sender repeats it, s.
            now: The instant.
        """
        is_suspected = now < self._suspected_until and not self._is_stored
        return is_suspected and self._may_be_older(timeout_s, now)

    def suspect(self, until: int) -> None:
        """Begin nothing that may be older than this life until then: a report contradicts it."""
        self._suspected_until = max(self._suspected_until, until)

    def told(self, reason: str, now: int) -> None:
        """Another node has shown that this one has forgotten something.

        That holds from the beginning of this life: what may be older is refused as if the store had
        reported it, in the next life as well.
        """
        if not self.reason:
            self.reason = reason
        if not self._is_stored and self._may_be_older(ns_to_seconds(self._longest_ns), now):
            self._is_stored = True
            self._journal.write(DOUBT_KEY, self.reason.encode())
        self._emit(JournalDoubted(reason=reason))

    def settle(self, now: int) -> None:
        """Delete the doubt from the journal once nobody repeats anything from before this life."""
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
