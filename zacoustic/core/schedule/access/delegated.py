"""Medium access by the device, or by what is behind it: a frame may be handed over at any time."""

from zacoustic.core.schedule.access.base import MediumAccess, Wanted


class Delegated(MediumAccess):
    """The link decides; the engine never waits."""

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the instant at which the frame is due."""
        return wanted.due_at
