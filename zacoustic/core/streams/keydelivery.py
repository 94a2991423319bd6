"""Keys for broadcasts, delivered across the channel: the service's id, and its request.

A node with an identity opens the broadcasts of another node by a secret that the list of members
holds, wrapped for it. A submerged vehicle cannot get a new list. So a node of the fleet can send it
one source's secret on command: the address of the source, then the secret wrapped for the vehicle
(RFC 3394) under a key of the pair, 41 bytes. The response is empty.
"""

from typing import Final

KEYS_STREAM_ID: Final = 173
"""Stream id of delivered keys, in every table that does not give it to another stream."""
KEYS_TIMEOUT_S: Final = 600.0
"""A delivery is repeated, and remembered as a call, for this long at most, s."""
WRAPPED_BYTES: Final = 40
"""A wrapped secret."""


def encode_delivery(source: int, wrapped: bytes) -> bytes:
    """Return the request.

    Args:
        source: The node whose broadcasts the secret opens, 1…254.
        wrapped: The wrapped secret.
    """
    return bytes((source,)) + wrapped


def decode_delivery(request: bytes) -> tuple[int, bytes]:
    """Return source and wrapped secret of a request.

    Raises:
        ValueError: It is no such request.
    """
    if len(request) != 1 + WRAPPED_BYTES or not 1 <= request[0] <= 254:
        raise ValueError(
            f"a request of {len(request)} bytes; allowed: an address and {WRAPPED_BYTES} bytes"
        )
    return request[0], request[1:]
