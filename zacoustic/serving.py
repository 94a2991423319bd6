"""What verbs that serve until they are interrupted share: where to listen, when to stop."""

import asyncio
import contextlib
import signal
import sys
from collections.abc import Iterator

from zacoustic.errors import ConfigError

_LAST_PORT = 65_535


def parse_place(place: str) -> tuple[str, int]:
    """Return host and port of ``HOST:PORT``; brackets around an IPv6 host are taken off.

    Raises:
        ConfigError: It is no such place; port 0 is one, any that is free.
    """
    host, colon, port = place.rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) <= _LAST_PORT):
        raise ConfigError(f"--listen {place!r}; allowed: HOST:PORT, port 0..{_LAST_PORT}")
    return host.removeprefix("[").removesuffix("]"), int(port)


@contextlib.contextmanager
def stopped_by_signals(stop: asyncio.Event) -> Iterator[None]:
    """Set `stop` on SIGINT and SIGTERM, also where the loop knows no signals; on the loop."""
    loop = asyncio.get_running_loop()
    numbers = (signal.SIGINT, signal.SIGTERM)
    if sys.platform == "win32":
        # A handler runs between two turns of the loop there, and must wake it by itself.
        previous = {
            number: signal.signal(number, lambda *_: loop.call_soon_threadsafe(stop.set))
            for number in numbers
        }
    else:
        for number in numbers:
            loop.add_signal_handler(number, stop.set)
    try:
        yield
    finally:
        if sys.platform == "win32":
            for number, handler in previous.items():
                signal.signal(number, handler)
        else:
            for number in numbers:
                loop.remove_signal_handler(number)
