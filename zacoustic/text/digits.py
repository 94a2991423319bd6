"""Numbers in keys, names, addresses and texts that anybody may have written.

`str.isdigit` takes "²", which `int` refuses, and both take the digits of every script: so
``stream/١`` was stream 1. Here a digit is 0…9, and a number ends before it is dear to read.
"""

MOST_DIGITS = 20
"""Digits of the largest number of 64 bits."""


def whole_number(text: str) -> int | None:
    """Return the number ≥ 0 that a text is, in ASCII digits; None: it is none, or too long."""
    if len(text) > MOST_DIGITS or not (text.isascii() and text.isdigit()):
        return None
    return int(text)


def real_number(text: str) -> float | None:
    """Return the number that a text is, as programs write it in ASCII; None: it is none."""
    if not text.isascii() or "_" in text:
        return None
    try:
        return float(text)
    except ValueError:
        return None
