"""When each stream crossed, how often, and the outcomes of frames to each node.

These facts stay true while nothing happens: instants by the wall clock and mean intervals, not
rates and ages, which an idle gateway would have to put again and again. Monitors compute rates and
ages (`zacoustic.app.tools.watch`).

The memory is bounded by 255 stream ids and 255 addresses.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from zacoustic.core.base.linktypes import BROADCAST, UNKNOWN_SOURCE, Service, TransmitOutcome
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.events import SampleReceived

EXCHANGES_KEPT: Final = 64
"""Number of last frames with a modem acknowledgement that the error rate to a node covers."""
# The mean covers about the last four intervals: it soon shows an override.
_WEIGHT: Final = 1 / 4


class Pulse:
    """When something happened last, and the mean interval."""

    def __init__(self) -> None:
        self.last_at_unix_s: float | None = None
        """Last time, s."""
        self.period_s: float | None = None
        """Mean interval, weighted towards the last ones, s; None: it happened at most once."""

    def beat(self, at_unix_s: float, times: int = 1) -> None:
        """Note that it happened, this many times since the last call."""
        if self.last_at_unix_s is not None:
            interval_s = max(at_unix_s - self.last_at_unix_s, 0.0) / times
            known_s = interval_s if self.period_s is None else self.period_s
            self.period_s = known_s + (interval_s - known_s) * _WEIGHT
        self.last_at_unix_s = at_unix_s


class Exchanges:
    """Frames to one node for which its modem should return an acknowledgement."""

    def __init__(self) -> None:
        self.delivered = 0
        """Acknowledged frames."""
        self.not_delivered = 0
        """Frames without acknowledgement."""
        self._last: deque[bool] = deque(maxlen=EXCHANGES_KEPT)

    @property
    def error_rate(self) -> float | None:
        """Packet error rate of the last frames, both ways together, 0…1; None: no frames."""
        return 1 - sum(self._last) / len(self._last) if self._last else None

    def note(self, is_delivered: bool) -> None:
        """Note the end of one."""
        self.delivered += is_delivered
        self.not_delivered += not is_delivered
        self._last.append(is_delivered)


class Traffic:
    """Figures of streams and nodes from the trace of one engine; for the loop.

    Args:
        unix_s: The wall clock, s.
    """

    def __init__(self, unix_s: Callable[[], float] = time.time) -> None:
        self._unix_s = unix_s
        self._sent: dict[int, Pulse] = {}
        self._heard: dict[int, Pulse] = {}
        self._ages_s: dict[int, float | None] = {}
        self._heard_at: dict[int, float] = {}
        self._received: dict[int, dict[str, dict[Service, tuple[int, int]]]] = {}
        self._exchanges: dict[int, Exchanges] = {}
        self._destination = BROADCAST

    def note(self, record: TraceRecord) -> None:
        """Take a record of the engine's trace."""
        match record.what:
            case "transmit":
                self._destination = record.peer
                self._beat(self._sent, record.streams)
            case "receive":
                if record.peer != UNKNOWN_SOURCE:
                    self._heard_at[record.peer] = self._unix_s()
                    by_link = self._received.setdefault(record.peer, {})
                    counts = by_link.setdefault(record.link, {})
                    frames, size_bytes = counts.get(record.service, (0, 0))
                    counts[record.service] = frames + 1, size_bytes + record.size_bytes
                self._beat(self._heard, record.streams)
            case "report":
                self._note_outcome(record.detail)

    def note_sample(self, event: SampleReceived) -> None:
        """Store the age of a sample as it arrived; None: unknown."""
        self._ages_s[event.stream_id] = event.age_s

    def heard_at_unix_s(self) -> dict[int, float]:
        """Return when each node was heard last, s since 1970."""
        return dict(self._heard_at)

    def received_from(self, address: int) -> dict[str, dict[Service, tuple[int, int]]]:
        """Return the number of frames from a node, and their bytes.

        By link, route and bond, and by the service that carried them.
        """
        return dict(self._received.get(address, {}))

    def of_stream(self, stream_id: int) -> dict[str, Any]:
        """Return the facts of a stream, members of its `StreamRow`."""
        sent = self._sent.get(stream_id) or Pulse()
        heard = self._heard.get(stream_id) or Pulse()
        return {
            "sent_at_unix_s": _milli(sent.last_at_unix_s),
            "sent_period_s": _milli(sent.period_s),
            "heard_at_unix_s": _milli(heard.last_at_unix_s),
            "heard_period_s": _milli(heard.period_s),
            "age_s": _milli(self._ages_s.get(stream_id)),
        }

    def of_peer(self, address: int) -> dict[str, Any]:
        """Return the outcomes of frames to a node, members of its `PeerRow`."""
        exchanges = self._exchanges.get(address) or Exchanges()
        return {
            "delivered": exchanges.delivered,
            "not_delivered": exchanges.not_delivered,
            "per": _milli(exchanges.error_rate),
        }

    def _beat(self, pulses: dict[int, Pulse], stream_ids: tuple[int, ...]) -> None:
        at_unix_s = self._unix_s()
        for stream_id in set(stream_ids):
            times = stream_ids.count(stream_id)
            pulses.setdefault(stream_id, Pulse()).beat(at_unix_s, times)

    def _note_outcome(self, outcome: str) -> None:
        is_delivered = outcome == TransmitOutcome.DELIVERED.value
        if is_delivered or outcome == TransmitOutcome.NOT_DELIVERED.value:
            self._exchanges.setdefault(self._destination, Exchanges()).note(is_delivered)


def _milli(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
