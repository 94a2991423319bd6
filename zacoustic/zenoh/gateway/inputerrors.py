"""Input errors of the local network: counts all, and logs a warning from time to time."""

import logging
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.text.safetext import one_line

# A sensor with the wrong unit at 100 Hz makes one line in this time, not a thousand.
QUIET_S: Final = 10.0
"""Time between two warnings about one stream, s."""

_logger = logging.getLogger(__name__)


class InputErrors:
    """Counts and warns; for the loop.

    Args:
        clock: Source of instants.
        quiet_s: Time between two warnings about one stream, s.
        tell: Receives each warning as well.
    """

    def __init__(
        self,
        clock: Clock,
        quiet_s: float = QUIET_S,
        *,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.counts: dict[str, dict[str, int]] = {}
        """Counts by stream and reason."""
        self._clock = clock
        self._tell = tell
        self._quiet_ns = seconds_to_ns(quiet_s)
        self._silent_until: dict[str, int] = {}
        self._unsaid: dict[str, int] = {}

    def add(self, stream: str, reason: str, text: str) -> None:
        """Count an error, and log it if no warning about the stream is recent.

        Args:
            stream: Name of the stream.
            reason: One word, the key of the counter.
            text: One line, without the name of the stream.
        """
        by_reason = self.counts.setdefault(stream, {})
        by_reason[reason] = by_reason.get(reason, 0) + 1
        now = self._clock()
        if now < self._silent_until.get(stream, now):
            self._unsaid[stream] = self._unsaid.get(stream, 0) + 1
            return
        self._silent_until[stream] = now + self._quiet_ns
        unsaid = self._unsaid.pop(stream, 0)
        more = f" (and {unsaid} more since the last warning)" if unsaid else ""
        line = " ".join(text.removeprefix(f"{stream}: ").split())
        warning = one_line(f"{stream}: {line}{more}")
        _logger.warning("%s", warning)
        self._tell(warning)
