"""Airtime caps: the share of the time that a stream, or the node, may transmit.

A cap is a share, such as 0.1, kept as an account. The share of the passing time is paid in, up to
the share of ten minutes, and the duration of each frame is taken out. A stream with a debt waits
until its account is even. So a frame may cause a debt, but over a long time the share holds, and a
cap that allows one photo per hour does not slow that photo down.

Each stream pays for its bytes in a frame; preamble, envelope and acknowledgements are divided in
the same proportion. The node alone pays for frames without a stream, such as a question about a
table.
"""

from collections.abc import Mapping
from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.schedule.access.base import Wanted

_SAVED_NS: Final = 600 * NS_PER_S
"""The share of this time can be saved up, ns."""


class AirtimeAccount:
    """The account of one cap.

    Args:
        share: Share of the time, above 0, at most 1.
        saved_ns: The share of this time can be saved up, ns.
    """

    def __init__(self, share: float, *, saved_ns: int = _SAVED_NS) -> None:
        self._share = share
        self._limit_ns = share * saved_ns
        self._balance_ns = self._limit_ns
        self._reckoned_at = 0

    def spend(self, airtime_ns: float, now: int) -> None:
        """Take out the airtime of a frame."""
        self._balance_ns = self._balance(now) - airtime_ns
        self._reckoned_at = now

    def even_at(self, now: int) -> int:
        """Return the instant from which it has no debt, ns; `now` if it has none."""
        balance_ns = self._balance(now)
        return now if balance_ns >= 0 else now + int(-balance_ns / self._share) + 1

    def _balance(self, now: int) -> float:
        earned_ns = max(0, now - self._reckoned_at) * self._share
        return min(self._limit_ns, self._balance_ns + earned_ns)


class AirtimeCaps:
    """The caps of one node.

    Args:
        total: The node's share; None: no cap.
    """

    def __init__(self, total: float | None) -> None:
        self._streams: dict[int, AirtimeAccount] = {}
        self._total = None if total is None else AirtimeAccount(total)

    def limit(self, stream_id: int, share: float | None) -> None:
        """Set the cap of a stream; None: no cap."""
        if share is not None:
            self._streams[stream_id] = AirtimeAccount(share)

    def spend(self, record_bytes: Mapping[int, int], airtime_ns: int, now: int) -> dict[int, int]:
        """Pay for a frame.

        Args:
            record_bytes: Bytes of each stream's records in it.
            airtime_ns: Its airtime, ns.
            now: Instant at which it starts.

        Returns:
            The streams with a debt, each with the instant until which it must wait.
        """
        if self._total is not None:
            self._total.spend(airtime_ns, now)
        whole_bytes = sum(record_bytes.values())
        held: dict[int, int] = {}
        for stream_id, size_bytes in record_bytes.items():
            account = self._streams.get(stream_id)
            if account is not None:
                account.spend(airtime_ns * size_bytes / whole_bytes, now)
                even_at = account.even_at(now)
                if even_at > now:
                    held[stream_id] = even_at
        return held

    def after_debt(self, wanted: Wanted, at: int, now: int) -> int:
        """Return when the node's account is even, ns, or `at`; urgent frames do not wait."""
        if self._total is None or wanted.is_urgent:
            return at
        even_at = self._total.even_at(now)
        return max(at, even_at) if even_at > now else at
