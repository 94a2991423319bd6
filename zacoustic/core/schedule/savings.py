"""Accounts for what dense blocks save over records, and what their acknowledgements cost."""

from typing import Final

# A block may be larger than the records by this much: later blocks that refer to it gain.
_INVESTED_BYTES: Final = 1
# A block that saves this much is always sent: an acknowledgement, its highest cost, is no more.
_CERTAIN_BYTES: Final = 4
# The balance is in 1/32 of a byte. It begins with the price of a trial, and recovers a little with
# every frame without blocks: one in a hundred is another trial.
_UNITS: Final = 32
_CREDIT: Final = 6 * _UNITS
_MOST: Final = 32 * _UNITS
_RECOVERED: Final = 1


class Savings:
    """Decides whether dense blocks are worth their cost."""

    def __init__(self) -> None:
        self._balance = _CREDIT

    def is_worth(self, block_bytes: int, records_bytes: int) -> bool:
        """Return whether to send a block in place of records."""
        saved_bytes = records_bytes - block_bytes
        if self._balance <= 0:
            self._balance += _RECOVERED
            return saved_bytes >= _CERTAIN_BYTES
        return saved_bytes >= -_INVESTED_BYTES

    def book(self, saved_bytes: int) -> None:
        """Add what a block saves (or costs, if negative), or what an acknowledgement costs."""
        self._balance = min(self._balance + saved_bytes * _UNITS, _MOST)
