"""DESERT's driver for this modem, as far as a modem can tell: what it says, reads and chokes on.

It searches everything that came for its words, wherever they stand, and takes the earliest. What
follows a word is read up to CR LF, a message by its length. Words that it finds and has no rule for
hold it up for ever: it is *wedged*, and reads nothing any more. It is as deaf after a message whose
length is wrong, and after a line without CR.
"""

import enum
from typing import Final

FINAL: Final = ("EMPTY", "DELIVERED", "DELIVEREDIM", "FAILED", "FAILEDIM", "SENDEND", "DROPCNT")
"""Answers that end its waiting for what it has sent."""
QUERY_EVERY_S: Final = 0.2
QUERIES: Final = 10
"""So often it asks `AT?DI`."""
BURST_WAIT_S: Final = 5.0

_HEADER_FIELDS: Final = 8
_READ: Final = (
    "OK", "EMPTY", "BUSY", "DELIVERING", "DELIVERED", "DROPCNT", "ERROR WRONG FORMAT",
    "ERROR UNKNOWN COMMAND", "ERROR BUFFER FULL", "FAILED", "RECVSTART", "RECVEND", "RECVFAILED",
    "SENDSTART", "SENDEND", "BITRATE", "USBLANGLES", "USBLLONG",
)  # fmt: skip
_WEDGING: Final = (
    "INITIATION NOISE", "INITIATION DEAF", "INITIATION LISTEN", "ERROR PHY OFF",
    "ERROR NOT ACCEPTED", "ERROR WRONG DESTINATION ADDRESS", "ERROR CONNECTION CLOSED",
    "ERROR BUFFER IS NOT EMPTY", "ERROR OUT OF RANGE", "ERROR PROTOCOL ID", "ERROR INTERNAL",
)  # fmt: skip
_MESSAGES: Final = ("RECVIM,", "RECV,")
_EARLIEST_FIRST: Final = (*_MESSAGES, *_READ, *_WEDGING)


class Mode(enum.Enum):
    """What it sends by."""

    UNACKNOWLEDGED = "noack"
    ACKNOWLEDGED = "ack"
    BURST = ""


class DesertDriver:
    """One of them.

    Args:
        mode: What it sends by.
        extended: In its extended protocol mode: with protocol ids, both ways.
    """

    def __init__(self, mode: Mode = Mode.UNACKNOWLEDGED, *, extended: bool = False) -> None:
        self.mode = mode
        self.received: list[bytes] = []
        """Payloads, in order."""
        self.read: list[str] = []
        """Everything else that it has understood."""
        self.wedged_by = ""
        """The words that hold it up."""
        self._pid = "p0," if extended else ""
        self._fields = _HEADER_FIELDS + extended
        self._buffer = b""

    def packet(self, destination: int, content: bytes) -> bytes:
        """Return the command that sends a packet."""
        if self.mode is Mode.BURST:
            head = f"AT*SEND,{self._pid}{len(content)},{destination},"
        else:
            head = f"AT*SENDIM,{self._pid}{len(content)},{destination},{self.mode.value},"
        return head.encode("ascii") + content + b"\n"

    def take(self, content: bytes) -> None:
        """Read what the modem says."""
        self._buffer += content
        while not self.wedged_by and self._take_one():
            pass

    def _take_one(self) -> bool:
        text = self._buffer.decode("latin-1")
        places = [(text.find(word), word) for word in _EARLIEST_FIRST if word in text]
        if not places:
            return False
        place, word = min(places, key=lambda found: found[0])
        if word in _WEDGING:
            self.wedged_by = word
            return False
        if word in _MESSAGES:
            return self._take_message(place)
        end = text.find("\r\n", place)
        if end < 0:
            return False
        self.read.append(text[place:end])
        self._buffer = self._buffer[end + 2 :]
        return True

    def _take_message(self, place: int) -> bool:
        token, *fields = self._buffer[place:].split(b",", self._fields + 1)
        if len(fields) <= self._fields:
            return False
        *numbers, rest = fields
        numbers = numbers[self._fields - _HEADER_FIELDS : -1]
        flags = {b"ack", b"noack", b"force"} if token == b"RECVIM" else set()
        # A field that is no number ends its reading thread.
        size, *_ = [int(number) for number in numbers if number not in flags]
        if len(rest) < size + 2:
            return False
        if rest[size : size + 2] != b"\r\n":
            self.wedged_by = "a message of another length"
            return False
        self.received.append(rest[:size])
        self._buffer = rest[size + 2 :]
        return True
