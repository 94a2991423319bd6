"""Frames and reports of the link as plain Zenoh keys, while somebody subscribes to them.

``@acoustic/ADDRESS/frames`` has a `FrameRecord` for each frame sent or received,
``@acoustic/ADDRESS/reports`` a `ReportRecord` for each transmission that has ended, both in JSON
with `unix_s`. Zenoh reports whether there are subscribers; without any, no record is made. Unlike
the health documents they are not state, so a `get` has no answer.
"""

import asyncio
import threading
import time
from functools import partial
from typing import Any, Final

import zenoh

from zacoustic.core.base.linktypes import ReceivedFrame, Transmission, TransmitReport
from zacoustic.core.base.qos import Priority
from zacoustic.core.values.encoding import JSON
from zacoustic.run.inbox import tell_loop
from zacoustic.run.recording.channels import received_frame, report_record, sent_frame
from zacoustic.run.recording.schemas import as_json
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.requests.request import PREFIX
from zacoustic.zenoh.session.session import ZenohSession

FRAMES: Final = "frames"
REPORTS: Final = "reports"


class FrameFeed:
    """The feed of one gateway; for the loop, except for `declare` and `undeclare`.

    Args:
        runner: Runs the link.
        zenoh_session: The session that puts it.
    """

    def __init__(self, runner: LinkRunner, zenoh_session: ZenohSession) -> None:
        self._runner = runner
        self._zenoh_session = zenoh_session
        self._loop = asyncio.get_running_loop()
        self._prefix = f"{PREFIX}/{runner.engine.address}"
        self._declared: list[Any] = []
        self._guard = threading.Lock()
        self._matching: dict[str, bool] = {}
        self._is_closed = False

    def declare(self) -> None:
        """Watch for subscribers; in the worker."""
        for name in (FRAMES, REPORTS):
            publisher = self._zenoh_session.session.declare_publisher(
                zenoh.KeyExpr(f"{self._prefix}/{name}"),
                allowed_destination=zenoh.Locality.REMOTE,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            listener = publisher.declare_matching_listener(
                self._zenoh_session.callback(partial(self._see, name))
            )
            self._declared += [publisher, listener]
            status: Any = publisher.matching_status  # an object, not the bool of the stub
            with self._guard:
                self._matching.setdefault(name, bool(status.matching))
        tell_loop(self._loop, self._settle)

    def undeclare(self) -> None:
        """Stop to watch; in the worker."""
        while self._declared:
            self._declared.pop().undeclare()

    def close(self) -> None:
        """Put nothing any more."""
        self._is_closed = True
        self._runner.watch = None

    def _see(self, name: str, status: zenoh.MatchingStatus) -> None:
        """Note whether there are subscribers; on a thread of Zenoh's."""
        with self._guard:
            self._matching[name] = bool(status.matching)
        tell_loop(self._loop, self._settle)

    def _settle(self) -> None:
        with self._guard:
            is_watched = any(self._matching.values()) and not self._is_closed
        self._runner.watch = self._put if is_watched else None

    def _put(self, crossing: ReceivedFrame | Transmission | TransmitReport, now: int) -> None:
        engine = self._runner.engine
        record: object
        name = FRAMES
        match crossing:
            case ReceivedFrame():
                record = received_frame(engine.address, crossing, engine.capabilities)
            case Transmission():
                record = sent_frame(engine.address, crossing, now, engine.capabilities)
            case TransmitReport():
                record, name = report_record(engine.address, crossing), REPORTS
        payload = as_json({**_fields(record), "unix_s": time.time()})
        key = f"{self._prefix}/{name}"
        self._zenoh_session.put(key, payload, encoding=JSON, priority=Priority.DATA_LOW)


def _fields(record: Any) -> dict[str, Any]:  # noqa: ANN401 (one of two records)
    return {name: getattr(record, name) for name in record.__struct_fields__}
