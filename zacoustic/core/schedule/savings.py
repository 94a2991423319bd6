"""What dense blocks save compared with records, and what their acknowledgements cost."""

from typing import Final

# A block may be so much larger than the records: what refers to it later gains.
_INVESTED_BYTES: Final = 1
# It goes in any case where it saves so much: an acknowledgement, which is the most it can cost.
_CERTAIN_BYTES: Final = 4
# The balance is in 1/32 of a byte. It begins with the price of finding out, and gets some of that
# back with every frame that goes without strings: one in a hundred is another try.
_UNITS: Final = 32
_CREDIT: Final = 6 * _UNITS
_MOST: Final = 32 * _UNITS
_RECOVERED: Final = 1


class Savings:
    """Whether strings are worth what is paid for them."""

    def __init__(self) -> None:
        self._balance = _CREDIT

    def is_worth(self, block_bytes: int, records_bytes: int) -> bool:
        """Tell whether a block is to go where records would say the same."""
        saved_bytes = records_bytes - block_bytes
        if self._balance <= 0:
            self._balance += _RECOVERED
            return saved_bytes >= _CERTAIN_BYTES
        return saved_bytes >= -_INVESTED_BYTES

    def book(self, saved_bytes: int) -> None:
        """Book what a block saves, or costs; or what an acknowledgement costs."""
        self._balance = min(self._balance + saved_bytes * _UNITS, _MOST)
