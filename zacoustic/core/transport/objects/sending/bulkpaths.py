"""Whether bulk data get through to other nodes, and how long this node sends without a pause."""

from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import ONE_LINK

_PATIENCE: Final = 3
"""So many attempts in a row are in vain at a node that is heard: its bulk service does not work."""
_PATIENCE_PROVEN: Final = 8
"""The same for a node that bulk data have reached: with four of ten frames lost, a device that
repeats a frame twice fails three times in a row again and again, and no other service does more."""
_PATIENCE_UNHEARD: Final = 12
"""The same for a node that is not heard: it may be out of range, for this and every service."""
_OFF_NS: Final = 600 * NS_PER_S
_MOST_OFF_DOUBLINGS: Final = 4
_FIRST_RUN_NS: Final = 12 * NS_PER_S
_LONGEST_RUN_NS: Final = 48 * NS_PER_S
_GROWTH: Final = 3
_HEARING_RUN_NS: Final = 24 * NS_PER_S
_SILENT_RUN_NS: Final = 96 * NS_PER_S
"""Where others are heard meanwhile: the run before a pause for one that was heard, and the run if
nobody was, ns."""


class BulkChanged(msgspec.Struct, frozen=True, kw_only=True):
    """Large samples to a node go another way from now on."""

    address: int
    """The node."""
    works: bool
    """Whether they go by the link's bulk service; otherwise, coded, by the plain one."""
    changed_at: int
    """Instant, ns."""
    link: str = ONE_LINK
    """Name of the link."""


class _Path:
    """The bulk service on the way to one node."""

    def __init__(self) -> None:
        self.is_proven = False
        self.failures = 0
        self.failed_since = 0
        self.off_until = 0
        self.spells = 0


class BulkPaths:
    """The bulk service on the way to each node."""

    def __init__(self) -> None:
        self._paths: dict[int, _Path] = {}

    def forget(self, address: int) -> None:
        """Forget a node."""
        self._paths.pop(address, None)

    def is_off(self, address: int, now: int) -> bool:
        """Return whether bulk data do not get through to a node, as far as is known."""
        path = self._paths.get(address)
        return path is not None and now < path.off_until

    def works(self, address: int) -> bool:
        """Record that something got through; return whether that is news."""
        path = self._paths.setdefault(address, _Path())
        path.is_proven = True
        was_off = bool(path.spells)
        path.spells = path.failures = path.off_until = 0
        return was_off

    def fails(self, address: int, heard_at: int, now: int) -> bool:
        """Record that nothing got through; return whether the service is given up.

        Args:
            address: The node.
            heard_at: When it was last heard, ns.
            now: The instant.
        """
        path = self._paths.setdefault(address, _Path())
        if not path.failures:
            path.failed_since = now
        path.failures += 1
        patience = _PATIENCE_UNHEARD
        if heard_at >= path.failed_since:
            patience = _PATIENCE_PROVEN if path.is_proven else _PATIENCE
        if path.failures < patience:
            return False
        path.failures = 0
        path.is_proven = False
        path.off_until = now + (_OFF_NS << min(path.spells, _MOST_OFF_DOUBLINGS))
        path.spells += 1
        return True


class BulkRuns:
    """How long this node sends fragments without a pause in which it hears others.

    A pause costs the sound of a fragment or more, so it should be worth that. If somebody was heard
    in the last one, the next comes soon; if nobody was, the run is longer each time. The receiver
    can ask for one: it is heard while a run is under way only if it sends something for that. Where
    what it has to say rides back with acknowledgements, it needs no pause but for a large sample.
    """

    def __init__(self) -> None:
        self.hears_meanwhile = False
        """Whether this node hears all others while a run is under way."""
        self._run_ns = _FIRST_RUN_NS
        self._begun_at: int | None = None
        self._paused_at: int | None = None

    def is_over(self, receiver_heard_at: int, now: int) -> bool:
        """Return whether a fragment that goes now should be the last before a pause.

        Args:
            receiver_heard_at: When the receiver was last heard, ns; -1 if never.
            now: The instant.
        """
        if self._begun_at is None:
            self._begun_at = now
        is_asked = receiver_heard_at > self._begun_at
        if self.hears_meanwhile:
            return now - self._begun_at >= (_HEARING_RUN_NS if is_asked else _SILENT_RUN_NS)
        return is_asked or now - self._begun_at >= self._run_ns

    def pause(self, now: int) -> None:
        """Record that a pause begins."""
        self._paused_at = now

    def go_on(self, heard_at: int, now: int) -> None:
        """Record that a fragment goes.

        Args:
            heard_at: When a node was last heard, ns; -1 if never.
            now: The instant.
        """
        if self._paused_at is None:
            return
        was_heard = heard_at >= self._paused_at
        longer_ns = min(_GROWTH * self._run_ns, _LONGEST_RUN_NS)
        self._run_ns = _FIRST_RUN_NS if was_heard else longer_ns
        self._begun_at, self._paused_at = now, None

    def rest(self) -> None:
        """Record that this node listens for another reason, so that a pause is not due."""
        self._begun_at = None

    def end(self) -> None:
        """Record that nothing more is to be sent: whatever follows begins anew."""
        self._begun_at = self._paused_at = None
        self._run_ns = _FIRST_RUN_NS
