"""The provider's gateway: mailboxes, what goes to whom, and what it costs."""

from collections import deque
from collections.abc import Callable
from typing import Final

from zacoustic_iridium.directip import FromModem

MOST_QUEUED: Final = 50
"""Messages that wait for one modem."""


class EmulatedGateway:
    """The gateway.

    Args:
        forward: Takes each message of a modem; None: it goes to all other modems, as it does for
            modems that are set up to write to each other.
        quantum_bytes: A message costs a multiple of this.
    """

    def __init__(
        self, forward: Callable[[FromModem], None] | None = None, *, quantum_bytes: int = 50
    ) -> None:
        self._forward = forward
        self._quantum_bytes = quantum_bytes
        self._boxes: dict[str, deque[bytes]] = {}
        self._rings: dict[str, Callable[[], None]] = {}
        self._numbers: dict[str, int] = {}
        self.paid_bytes = 0
        """What all messages have cost, bytes."""
        self.messages: list[FromModem] = []
        """All that modems have sent, those that came twice included."""

    def add(self, imei: str, ring: Callable[[], None]) -> None:
        """Add a modem; `ring` tells it that a message waits."""
        self._boxes[imei] = deque()
        self._rings[imei] = ring

    def accept(self, message: FromModem) -> None:
        """Take a message of a modem; an empty one is a look into its mailbox."""
        self._pay(len(message.data))
        if not message.data:
            return
        self.messages.append(message)
        if self._forward is not None:
            self._forward(message)
            return
        for imei in self._boxes:
            if imei != message.imei:
                self.queue(imei, message.data)

    def queue(self, imei: str, data: bytes) -> int:
        """Queue a message for a modem; return its place in the queue, or an error, < 0."""
        box = self._boxes.get(imei)
        if box is None:
            return -1
        if len(box) >= MOST_QUEUED:
            return -5
        box.append(data)
        self._rings[imei]()
        return len(box)

    def take(self, imei: str) -> tuple[bytes, int] | None:
        """Take the next message for a modem, with its number; None: none waits."""
        box = self._boxes[imei]
        if not box:
            return None
        self._numbers[imei] = self._numbers.get(imei, 0) + 1
        data = box.popleft()
        self._pay(len(data))
        return data, self._numbers[imei]

    def put_back(self, imei: str, data: bytes) -> None:
        """Put a message back that has not reached its modem."""
        self._boxes[imei].appendleft(data)

    def waiting(self, imei: str) -> int:
        """Return how many messages wait for a modem."""
        return len(self._boxes[imei])

    def _pay(self, size_bytes: int) -> None:
        quanta = max(1, -(-size_bytes // self._quantum_bytes))
        self.paid_bytes += quanta * self._quantum_bytes
