"""Medium access by the device, or by what is behind it: a frame may be handed over at any time."""

from zacoustic.core.access.base import MediumAccess


class Delegated(MediumAccess):
    """The link decides; the engine never waits."""

    def ready_at(self, now: int) -> int | None:
        """Return `now`."""
        return now
