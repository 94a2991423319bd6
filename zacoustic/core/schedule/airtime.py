"""Airtime caps: how much of the time a stream, or the node, may be on the air.

A cap is a share, such as 0.1, kept as an account. The share of the passing time is paid in, up to
the share of ten minutes, and the duration of each frame is taken out. A stream with a debt waits
until its account is even. So a frame may cause a debt, but over a long time the share holds, and a
photo once an hour is not slowed down by a cap that an hour allows.

Each stream pays for its bytes in a frame; preamble, envelope and acknowledgements are shared out in
the same proportion. Frames of no stream, such as a question about a table, are paid by the node
alone.
"""

from collections.abc import Mapping
from typing import Final

from zacoustic.core.base.clock import NS_PER_S

_SAVED_NS: Final = 600 * NS_PER_S
"""The share of this time can be saved up, ns."""


class AirtimeAccount:
    """One cap.

    Args:
        share: Share of the time, above 0, at most 1.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self._limit_ns = share * _SAVED_NS
        self._balance_ns = self._limit_ns
        self._reckoned_at = 0

    def spend(self, airtime_ns: float, now: int) -> None:
        """Take out what a frame lasts."""
        self._balance_ns = self._balance(now) - airtime_ns
        self._reckoned_at = now

    def even_at(self, now: int) -> int:
        """Return the instant from which it is not in the red; `now` or before: it is not."""
        balance_ns = self._balance(now)
        return now if balance_ns >= 0 else now + int(-balance_ns / self._share) + 1

    def _balance(self, now: int) -> float:
        earned_ns = max(0, now - self._reckoned_at) * self._share
        return min(self._limit_ns, self._balance_ns + earned_ns)


class AirtimeCaps:
    """The caps of one node.

    Args:
        total: Share of the node; None: no cap.
    """

    def __init__(self, total: float | None) -> None:
        self._streams: dict[int, AirtimeAccount] = {}
        self._total = None if total is None else AirtimeAccount(total)

    def limit(self, stream_id: int, share: float | None) -> None:
        """Give a stream a cap; None: none."""
        if share is not None:
            self._streams[stream_id] = AirtimeAccount(share)

    def spend(self, record_bytes: Mapping[int, int], airtime_ns: int, now: int) -> dict[int, int]:
        """Pay for a frame.

        Args:
            record_bytes: Bytes of the records of each stream in it.
            airtime_ns: How long it lasts.
            now: Instant at which it starts.

        Returns:
            The streams that are in the red now, each with the instant until which it has to wait.
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

    def free_at(self, now: int) -> int:
        """Return the instant from which the node may transmit, but for what is urgent."""
        return now if self._total is None else self._total.even_at(now)
