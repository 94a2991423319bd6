"""All requests that a gateway declares."""

from typing import Any, Final

from zacoustic.zenoh.requests.cancel import CANCEL
from zacoustic.zenoh.requests.commands import SILENCE, STREAM
from zacoustic.zenoh.requests.key import KEY
from zacoustic.zenoh.requests.ping import PING
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.requests.routing import ROUTING

REQUESTS: Final[tuple[Request[Any, Any], ...]] = (SILENCE, STREAM, PING, KEY, ROUTING, CANCEL)
"""The rows."""
