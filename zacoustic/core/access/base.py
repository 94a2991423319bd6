"""The interface of a medium access policy."""

from abc import ABC, abstractmethod


class MediumAccess(ABC):
    """Decides when a frame may start; told what happens on the channel; owns no timer."""

    @abstractmethod
    def ready_at(self, now: int) -> int | None:
        """Return the instant, ns, at which a frame may start: at or before `now` means at once.

        None means that it depends on an input that has not come yet, such as the end of a carrier.
        """

    def handle_carrier(self, busy: bool, now: int) -> None:  # noqa: B027  a policy may ignore it
        """Somebody else's transmission began or ended."""

    def handle_transmitted(self, now: int) -> None:  # noqa: B027  a policy may ignore it
        """An own transmission has ended."""
