"""The calls of a node at its End, a Zenoh network."""

from typing import Any, Final

from zacoustic.zenoh.ends.zenohcalls import CallForm
from zacoustic.zenoh.node.routes import ServiceRoute
from zacoustic.zenoh.session.marker import is_marked
from zacoustic.zenoh.session.values import said_encoding

CALLS_LIMIT: Final = 64
"""Most calls of one service under way: as many as a client may have on the channel."""


class ProgramCalls(CallForm):
    """The messages of one service, of a program.

    Args:
        route: The service.
    """

    def __init__(self, route: ServiceRoute[Any, Any]) -> None:
        self._route = route

    @property
    def key(self) -> str:
        """The key of the service."""
        return self._route.name

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether it is a gateway's mark."""
        return is_marked(attachment)

    def read_request(self, payload: bytes, encoding: object) -> tuple[object, str]:
        """Decode by the encoding; a `get` without a payload is an empty request."""
        route = self._route
        if not payload and route.request.spec is not None:
            return route.request.spec.validate({}), route.encoding
        said = said_encoding(encoding, route.encoding)
        return route.request.read(payload, said), route.encoding

    def write_response(self, value: object, encoding: str) -> tuple[bytes, str]:
        """Check the value, and encode it."""
        return self._route.response.write(value, encoding), encoding

    def write_request(self, value: object) -> tuple[bytes, str]:
        """Check the value, and encode it."""
        return self._route.request.write(value, self._route.encoding), self._route.encoding

    def read_response(self, payload: bytes, encoding: object) -> object:
        """Decode by the encoding."""
        said = said_encoding(encoding, self._route.encoding)
        return self._route.response.read(payload, said)

    def answer_mark(self, asked: bytes | None) -> None:
        """Return nothing: only gateways mark."""
