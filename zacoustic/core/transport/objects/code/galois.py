"""Arithmetic on rows of bytes in GF(256), with the polynomial x⁸ + x⁴ + x³ + x² + 1 (0x11D).

Addition is exclusive-or. A row is multiplied by one call of `bytes.translate`, which runs in C:
about 0.1 µs for 60 bytes, so neither a compiled extension nor numpy is needed for the sizes that
go over sound.
"""

from functools import cache
from typing import Final

_POLYNOMIAL: Final = 0x11D


def _powers() -> tuple[bytes, bytes]:
    """Return the powers of 2, and their logarithms."""
    exponents = bytearray(255)
    logarithms = bytearray(256)
    power = 1
    for exponent in range(255):
        exponents[exponent] = power
        logarithms[power] = exponent
        power <<= 1
        if power & 0x100:
            power ^= _POLYNOMIAL
    return bytes(exponents), bytes(logarithms)


_EXPONENTS, _LOGARITHMS = _powers()


@cache
def products(factor: int) -> bytes:
    """Return the products of a factor with 0…255, as a table for `bytes.translate`."""
    if factor == 0:
        return bytes(256)
    shift = _LOGARITHMS[factor]
    return bytes([0] + [_EXPONENTS[(shift + _LOGARITHMS[value]) % 255] for value in range(1, 256)])


def inverse(value: int) -> int:
    """Return the multiplicative inverse of a value that is not 0."""
    return _EXPONENTS[-_LOGARITHMS[value] % 255]


def combine(coefficients: bytes, rows: list[bytes]) -> int:
    """Return the sum of the rows, each times its coefficient, as a big-endian integer."""
    total = 0
    for coefficient, row in zip(coefficients, rows, strict=True):
        if coefficient:
            total ^= int.from_bytes(row.translate(products(coefficient)), "big")
    return total
