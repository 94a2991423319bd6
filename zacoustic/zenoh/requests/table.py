"""All requests that a gateway declares."""

from typing import Any, Final

from zacoustic.zenoh.requests.key import KEY
from zacoustic.zenoh.requests.request import Request

REQUESTS: Final[tuple[Request[Any, Any], ...]] = (KEY,)
"""The rows."""
