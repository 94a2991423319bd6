"""Tells how to install what is missing.

zacoustic is on no package index yet, so its own packages come from a checkout. Once it is
published, this module and the pages change, and nothing else.
"""

from typing import Final

OURSELVES: Final = "in zacoustic's checkout: pip install -e ."
"""How to install zacoustic anew, with its links and what it needs."""


def with_extra(extra: str) -> str:
    """Return how to install zacoustic with one of its extras.

    Args:
        extra: Its name in pyproject.toml, such as `ros`.
    """
    return f"in zacoustic's checkout: pip install '.[{extra}]'"
