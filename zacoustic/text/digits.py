"""Reads numbers in keys, names, addresses and texts that anybody may have written.

`str.isdigit` accepts "²", which `int` refuses, and both accept the digits of every script, so
``stream/١`` would be stream 1. Here a digit is 0…9, and a number that is too long to parse cheaply
is refused.
"""

MOST_DIGITS = 20
"""Number of digits of the largest 64-bit number."""


def whole_number(text: str) -> int | None:
    """Return the number ≥ 0 in ASCII digits; None: the text is none, or too long."""
    if len(text) > MOST_DIGITS or not (text.isascii() and text.isdigit()):
        return None
    return int(text)


def real_number(text: str) -> float | None:
    """Return the number in ASCII, as programs write it; None: the text is none."""
    if not text.isascii() or "_" in text:
        return None
    try:
        return float(text)
    except ValueError:
        return None
