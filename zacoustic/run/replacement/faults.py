"""`Faults`: the exceptions of an engine, and the pauses between new engines.

Nothing that comes over a link may raise, so an exception there is a bug of this program. It must
not disable a vehicle. A new engine continues from the journal, but it costs a boot epoch, of which
there are 65,536, and all state outside of the journal. So a frame that raised is refused for a
while, and after `FREE` faults in a row the pauses grow.
"""

import logging
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns

FREE: Final = 8
"""Faults without a pause; every `FORGET_S` one fault is forgotten."""
FORGET_S: Final = 600.0
"""Time without a fault after which one of them is forgotten, s."""
FIRST_PAUSE_S: Final = 1.0
"""Pause after the first fault beyond `FREE`, s; doubled with each further one."""
LONGEST_PAUSE_S: Final = 60.0
"""Longest pause, s: at one epoch a minute the epochs last 45 days."""
FRAME_PAUSE_S: Final = 60.0
"""Time for which a frame that has raised is refused, s; doubles each time it raises again."""
MOST_FRAMES: Final = 256
"""Most frames remembered."""
_LONGEST_FRAME_PAUSE_S: Final = 86_400.0
REPORT: Final = (
    "This is a bug of zacoustic: please report the lines above, the version, and the configuration"
)

_logger = logging.getLogger(__name__)


class Faults:
    """The exceptions raised by the engines of one node.

    Args:
        address: Address of the node, for the log.
    """

    def __init__(self, address: int) -> None:
        self.count = 0
        """Number of faults."""
        self._address = address
        self._level = 0
        self._last_at = 0
        self._deaf_until = 0
        self._frames: dict[bytes, tuple[int, int]] = {}

    def refuses(self, frame_bytes: bytes, now: int) -> bool:
        """Tell whether to refuse a frame now: it has raised, or there were too many."""
        _, until = self._frames.get(frame_bytes, (0, 0))
        return now < until or now < self._deaf_until

    def note(
        self, error: Exception, now: int, *, frame: bytes | None = None, event: object = None
    ) -> float:
        """Count a fault and log it.

        Args:
            error: The exception.
            now: The instant, ns.
            frame: The frame that raised; None: the cause was another one.
            event: The event whose receiver raised; the engine is unaffected.

        Returns:
            Pause before a new engine is made, s. After a frame it is 0: the new engine is made at
            once, and refuses frames for that pause.
        """
        self.count += 1
        forgotten = (now - self._last_at) // seconds_to_ns(FORGET_S)
        self._level = max(0, self._level - forgotten) + 1
        self._last_at = now
        pause_s = 0.0
        if self._level > FREE:
            pause_s = _doubled(FIRST_PAUSE_S, self._level - FREE, LONGEST_PAUSE_S)
        came_of = "" if frame is None else f" of the frame {frame.hex()}"
        goes_on = "the engine goes on from its journal" if event is None else f"of event {event}"
        _logger.error(
            "node %d: internal_error %d%s; %s%s. %s",
            self._address,
            self.count,
            came_of,
            goes_on,
            f" after {pause_s:g} s" if pause_s else "",
            REPORT,
            exc_info=error,
        )
        if frame is None:
            return pause_s
        self._deaf_until = now + seconds_to_ns(pause_s)
        raised, _ = self._frames.pop(frame, (0, 0))
        until = now + seconds_to_ns(_doubled(FRAME_PAUSE_S, raised + 1, _LONGEST_FRAME_PAUSE_S))
        self._frames[frame] = (raised + 1, until)
        while len(self._frames) > MOST_FRAMES:
            del self._frames[next(iter(self._frames))]
        return 0.0


def _doubled(first_s: float, times: int, longest_s: float) -> float:
    """Return the pause of an attempt by its number."""
    return min(longest_s, first_s * 2.0 ** min(times - 1, 32))
