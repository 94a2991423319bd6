"""Access to our pages: only for browsers that show them, not for other pages through a browser.

A page on the network of a vessel has no password, so another open page must not reach it through
the same browser. Two checks prevent that. `Host` is the name under which the browser found us: a
name that was redirected to this address is not ours. `Origin` is the requesting page: it must be
one that we have served. And no page may show ours in a frame, under a false button.
"""

import ipaddress
import socket
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from typing import Any, Final

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Message, Receive, Send], Awaitable[None]]

_FORBIDDEN: Final = 403
_POLICY_VIOLATION: Final = 1008


def own_names(*others: str) -> frozenset[str]:
    """Return the names of this computer, and `others`."""
    name = socket.gethostname()
    return frozenset(each.lower() for each in ("localhost", name, f"{name}.local", *others))


class Gatekeeper:
    """Wraps an ASGI application: refuses requests that do not come from our pages.

    Args:
        application: Answers the other requests.
        names: Names of this computer, lower case; addresses are always allowed.
        hint: How a user adds a name.
    """

    def __init__(
        self, application: Application, names: Collection[str], *, hint: str = "--name"
    ) -> None:
        self._application = application
        self._names = names
        self._hint = hint

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer one request, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._application(scope, receive, send)
            return
        refusal = self._refusal(dict(scope["headers"]))
        if not refusal:
            await self._application(scope, receive, _unframed(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": _POLICY_VIOLATION, "reason": refusal})
        else:
            head = [(b"content-type", b"text/plain; charset=utf-8")]
            await send({"type": "http.response.start", "status": _FORBIDDEN, "headers": head})
            await send({"type": "http.response.body", "body": f"{refusal}\n".encode()})

    def _refusal(self, headers: dict[bytes, bytes]) -> str:
        """Return why a request is refused; empty: it is not."""
        host = headers.get(b"host", b"").decode("latin-1").lower()
        if not self._is_ours(host):
            return f"refused: this page has no such name; use its address, or {self._hint}"
        origin = headers.get(b"origin")
        if origin is not None and origin.decode("latin-1").lower().partition("://")[2] != host:
            return "refused: another page has asked"
        return ""

    def _is_ours(self, host: str) -> bool:
        name, colon, port = host.rpartition(":")
        if not (colon and port.isascii() and port.isdigit()):
            name = host
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
        except ValueError:
            return False
        return True


def _unframed(send: Send) -> Send:
    """Forbid other pages to show an answer in a frame."""

    async def say(message: Message) -> None:
        if message["type"] == "http.response.start":
            denied = (b"x-frame-options", b"DENY")
            message = {**message, "headers": [*message.get("headers", ()), denied]}
        await send(message)

    return say
