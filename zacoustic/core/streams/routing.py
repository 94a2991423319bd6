"""The stream of commands about routes, which every table has; `zacoustic.core.wire.routing`."""

from typing import Final

ROUTING_STREAM_ID: Final = 172
"""Stream id of commands about routes, in every table that does not give it to another stream."""
ROUTING_TIMEOUT_S: Final = 600.0
"""A command is repeated, and remembered as a call, for this long at most, s."""
