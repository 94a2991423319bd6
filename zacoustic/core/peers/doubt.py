"""Doubt: this node may have forgotten what it did before this start.

A journal may be damaged, or somebody may have restored an old copy. The node continues in a new
epoch with what is valid in it. But it does not know what it did last, and must not do it again if
it arrives again. A client repeats a call or goal no longer than its time-out. Within that time
after the start, a call or goal may be older than this boot epoch: the node does not begin it and
answers that its outcome is *unknown*, which is true. Remote commands are not held up in either
direction: they carry their age and do no harm twice.

The journal detects most of this by itself and leaves an entry. Subscribers detect the rest
(`zacoustic.core.transport.reliable.sending.contradictions`) and report it to the node. A report may
be forged or late, so the node believes it when it comes a second time. Until then it refuses
nothing and begins nothing: it drops a call or goal that may be older than this boot epoch, and the
client repeats it.
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
    """The journal may lack the last writes: it is damaged, or an old copy was restored.

    The node continues with what is valid in it. It does not repeat earlier work whose outcome it
    does not know: see `zacoustic.core.peers.doubt`.
    """

    reason: str
    """What was found, and by whom, one line."""


class Doubt:
    """Whether the journal is in doubt, and what the node refuses because of that.

    Args:
        address: Address of the node.
        table: Its streams.
        stored: What the journal had at the start.
        journal: Drops the entry when the doubt does not matter any more.
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
        """Why the journal is in doubt, one line, for the whole boot epoch; empty: it is not."""
        self._is_stored = bool(self.reason)
        self._is_own_word = bool(self.reason)
        self._is_explained = False
        self._began_at: int | None = None
        self._suspected_until = 0
        if self.reason:
            emit(JournalDoubted(reason=self.reason))

    def link_up(self, now: int) -> None:
        """Note that the link is up: from now on this node hears repetitions of others."""
        if self._began_at is None:
            self._began_at = now

    def covers(self, timeout_s: float, now: int) -> bool:
        """Return whether an arriving call may be older than this boot epoch, and executed then.

        Args:
            timeout_s: For how long its sender repeats it, s.
            now: The instant.
        """
        return self._is_stored and self._may_be_older(timeout_s, now)

    def suspends(self, timeout_s: float, now: int) -> bool:
        """Return whether an unconfirmed report would cover an arriving call: it must not begin.

        Args:
            timeout_s: For how long its sender repeats it, s.
            now: The instant.
        """
        is_suspected = now < self._suspected_until and not self._is_stored
        return is_suspected and self._may_be_older(timeout_s, now)

    def suspect(self, until: int) -> None:
        """Begin nothing until then that may be older than this epoch: a report contradicts it."""
        self._suspected_until = max(self._suspected_until, until)

    def told(self, reason: str, now: int) -> None:
        """Note that another node has shown that this one forgot something.

        It holds from the start of this boot epoch, and after the next start as well: the node
        refuses what may be older, as if the journal had reported the damage.
        """
        if self._is_explained:
            return
        if not self.reason:
            self.reason = reason
        if not self._is_stored and self._may_be_older(ns_to_seconds(self._longest_ns), now):
            self._is_stored = True
            self._journal.write(DOUBT_KEY, self.reason.encode())
        self._emit(JournalDoubted(reason=reason))

    def explain(self) -> None:
        """Take back what others have shown: they have heard another node with this address."""
        self._is_explained = True
        if self.reason and not self._is_own_word:
            self.reason = ""
            if self._is_stored:
                self._is_stored = False
                self._journal.write(DOUBT_KEY, None)

    def settle(self, now: int) -> None:
        """Drop the journal entry once nobody repeats anything from before this boot epoch."""
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
