"""Health as plain Zenoh keys: the state of the link, the channel and the streams.

JSON under ``@acoustic/ADDRESS/``, put on a change, at most once in `INTERVAL_S` and with no more
than `BYTES_PER_S` of each, and as answer to a `get`:

============  =====================================================================================
``node``      name, version, start, locator
``link``      state, capabilities and reports of the device, frames, bytes, airtime
``ledger``    every byte on the link by stream and cause, with its share of the airtime
``peers``     nodes heard: epoch, table, when, outcomes of frames to each, and the modem's newest
              measurements of it
``streams``   digest of the table, nodes that differ; for each stream counters, jobs, when it
              crossed and how often; missed deadlines; outcomes of reliable samples; overrides of
              topics that this node publishes; subscribers and publishers of on-demand topics
``objects``   samples larger than a frame: their progress, the outcomes of the last ones
``channel``   the frame being sent, the last ones sent and heard
``journal``   whether anything survives a restart, why it cannot be written now, and why it may
              lack the last writes (a line that ``node`` has as well)
``events``    the last notable events, errors among them
``dropped``   dropped receptions and useless local input
``clock``     the time here; as answer to a `get`, and put when somebody has set the clock
============  =====================================================================================

``contact/NAME`` for each entry of ``lost_contact``, by `lostcontact`, and the peer status by
`peer_status`: ``peer/ADDRESS/lost``, ``…/late``, ``…/range``, ``…/position``, ``…/direction``,
``modem``.

The keys begin with ``@``: no wildcard of an application and no stream covers them, so they never
cross the channel. A change arms the only timer, once: an idle gateway has none.
"""

import asyncio
import math
from typing import Final

import msgspec

from zacoustic.core.base.qos import Priority
from zacoustic.core.values.encoding import JSON
from zacoustic.zenoh.gateway.status.dates import Dates
from zacoustic.zenoh.gateway.status.report import Report
from zacoustic.zenoh.requests.report import REPORT
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery
from zacoustic.zenoh.session.session import ZenohSession

INTERVAL_S: Final = 1.0
"""Minimum time between two puts of one document, s."""
BYTES_PER_S: Final = 8_000
"""Rate of puts of a larger document, bytes per second: `peers` of 254 nodes has some 80 kB."""


class Health:
    """The health report of one gateway, on its local network; for the loop.

    Args:
        address: Acoustic address of the gateway.
        zenoh_session: The session that puts it.
        report: The documents.
        dates: Dates of the documents.
        interval_s: Minimum time between two puts of one document, s.
    """

    def __init__(
        self,
        address: int,
        zenoh_session: ZenohSession,
        report: Report,
        dates: Dates,
        *,
        interval_s: float = INTERVAL_S,
    ) -> None:
        self._prefix = REPORT.key(address, "")
        self._zenoh_session = zenoh_session
        self._report = report
        self._dates = dates
        self._times_set = 0
        self._interval_s = interval_s
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._is_closed = False
        self._last_at_s = float("-inf")
        self._published: dict[str, bytes] = {}
        self._free_at_s: dict[str, float] = {}

    def touch(self) -> None:
        """Publish soon, because something has changed."""
        self._arm(max(self._loop.time(), self._last_at_s + self._interval_s))

    def answer(self, held: HeldQuery) -> None:
        """Answer a `get`."""
        asked = held.query.key_expr
        # Monitors ask for the clock every second, as a check that this gateway runs.
        is_pulse = str(asked).endswith("/clock")
        documents = {**({} if is_pulse else self._encoded()), **self._clock_document()}
        held.answer(
            [
                Answer(key=key, payload=payload, encoding=JSON)
                for key, payload in documents.items()
                if asked.intersects(key)
            ]
        )

    def close(self) -> None:
        """Publish nothing any more."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _publish(self) -> None:
        self._timer = None
        now_s = self._last_at_s = self._loop.time()
        later_at_s = math.inf
        documents = self._encoded()
        if self._times_set != self._dates.times_set:
            self._times_set = self._dates.times_set
            documents = {**self._clock_document(), **documents}  # before those with dates by it
        for key, payload in documents.items():
            if self._published.get(key) == payload:
                continue
            free_at_s = self._free_at_s.get(key, now_s)
            if free_at_s > now_s:
                later_at_s = min(later_at_s, free_at_s)
                continue
            self._published[key] = payload
            self._zenoh_session.put(key, payload, encoding=JSON, priority=Priority.DATA_LOW)
            if len(payload) > BYTES_PER_S * self._interval_s:
                self._free_at_s[key] = now_s + len(payload) / BYTES_PER_S
        if later_at_s < math.inf:
            self._arm(max(later_at_s, now_s + self._interval_s))

    def _arm(self, due_at_s: float) -> None:
        """Publish at that instant, unless an earlier one is planned."""
        if self._is_closed or (self._timer is not None and self._timer.when() <= due_at_s):
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_at(due_at_s, self._publish)

    def _clock_document(self) -> dict[str, bytes]:
        """Return the document by which a client compares the wall clocks."""
        self._dates.look()
        now = {"now_unix_s": self._dates.now_unix_s()}
        return {f"{self._prefix}clock": msgspec.json.encode(now)}

    def _encoded(self) -> dict[str, bytes]:
        return {
            f"{self._prefix}{name}": msgspec.json.encode(document, order="deterministic")
            for name, document in self._report.documents().items()
        }
