"""All requests that a gateway declares."""

from typing import Any, Final

from zacoustic.zenoh.requests.key import KEY
from zacoustic.zenoh.requests.ping import PING
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.requests.routing import ROUTING

REQUESTS: Final[tuple[Request[Any, Any], ...]] = (PING, KEY, ROUTING)
"""The rows."""
