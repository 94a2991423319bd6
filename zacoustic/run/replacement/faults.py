"""`Faults`: the exceptions of an engine, and how slowly it is tried again.

Nothing that comes over a link may raise, so an exception there is a bug of this program. It must
not take a vehicle away either. A new engine goes on from the journal, and that costs a boot epoch,
of which there are 65,536, and all that was only in memory. So a frame that raised is not taken
again for a while, and after `FREE` faults in a row the pauses grow.
"""

import logging
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns

FREE: Final = 8
"""Faults that are followed by no pause; one is forgotten in `FORGET_S`."""
FORGET_S: Final = 600.0
"""Time without a fault after which one of them is forgotten, s."""
FIRST_PAUSE_S: Final = 1.0
"""Pause after the first fault beyond `FREE`, s; doubled with each further one."""
LONGEST_PAUSE_S: Final = 60.0
"""Longest pause, s: one epoch a minute lasts for 45 days."""
FRAME_PAUSE_S: Final = 60.0
"""Time for which a frame that has raised is not taken, s; doubled each time it raises again."""
MOST_FRAMES: Final = 256
"""Frames that are remembered."""
_LONGEST_FRAME_PAUSE_S: Final = 86_400.0
REPORT: Final = (
    "This is a bug of zacoustic: please report the lines above, the version, and the configuration"
)

_logger = logging.getLogger(__name__)


class Faults:
    """What the engines of one node have raised.

    Args:
        address: Address of the node, for the log.
    """

    def __init__(self, address: int) -> None:
        self.count = 0
        """How many there were."""
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
        """Take note of a fault, and log it.

        Args:
            error: What was raised.
            now: The instant, ns.
            frame: What came over the link and raised; None: it was something else.
            event: The event whose receiver has raised; the engine is as it was then.

        Returns:
            The time for which no new engine is made, s. After a frame it is 0: the new engine
            lives at once, and hears nothing for as long.
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
    """Return the pause of the how many-th time."""
    return min(longest_s, first_s * 2.0 ** min(times - 1, 32))
