"""The refusals that drivers have met: the emulator says them, the driver knows what each means.

Their words are for people, and vary: drivers have met three spellings of one.
"""

from typing import Final

from zacoustic_evologics.at.replies import RefusalKind, Refused


def _error(reason: str) -> Refused:
    return Refused(RefusalKind.ERROR, reason)


WRONG_FORMAT: Final = _error("WRONG FORMAT")
UNKNOWN_COMMAND: Final = _error("UNKNOWN COMMAND")
OUT_OF_RANGE: Final = _error("OUT OF RANGE")
OUT_OF_CONTEXT: Final = _error("OUT OF CONTEXT")
WRONG_DESTINATION: Final = _error("WRONG DESTINATION ADDRESS")
PROTOCOL_ID: Final = _error("PROTOCOL ID")
NO_CONTROL: Final = _error("NO CONTROL")
NOT_ALLOWED: Final = _error("NOT ALLOWED IN AUTOMATIC REGIME")
NOT_ACCEPTED: Final = _error("NOT ACCEPTED")
CONNECTION_CLOSED: Final = _error("CONNECTION CLOSED")
PHY_OFF: Final = _error("PHY OFF")
BUFFER_FULL: Final = _error("BUFFER FULL")
BUFFERS_NOT_EMPTY: Final = _error("BUFFERS ARE NOT EMPTY")
BACKOFF: Final = Refused(RefusalKind.BUSY, "BACKOFF STATE")
DELIVERING: Final = Refused(RefusalKind.BUSY, "DELIVERING INSTANT MESSAGE")


def is_not_empty(refusal: Refused) -> bool:
    """Tell whether a modem refuses since its buffer has something: three spellings are known."""
    return refusal.reason.startswith("BUFFER") and refusal.reason.endswith("NOT EMPTY")
