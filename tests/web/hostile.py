"""Visitors that a web page should not have, in a process of their own.

    python -m tests.web.hostile PORT slow|headers|silent COUNT

`slow` begins a request on each of COUNT connections and sends a byte of it every half second;
`silent` sends nothing; `headers` sends headers without end, on few connections as fast as they are
taken. What is dropped comes again after a second. On standard output: `ready` when each connection
was tried, then every second how many are open, and how many bytes were taken. Ends with its
standard input.
"""

import contextlib
import errno
import selectors
import socket
import sys
import time

HEAD = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
HEADERS = b"".join(b"X-%d: %s\r\n" % (each, b"a" * 90) for each in range(600))


class Visitor:
    """One connection, again and again."""

    def __init__(self, port: int, kind: str, selector: selectors.BaseSelector) -> None:
        self.port = port
        self.kind = kind
        self.selector = selector
        self.socket: socket.socket | None = None
        self.sent = 0
        self.again_at = 0.0

    def visit(self) -> None:
        self.leave()
        self.socket = socket.socket()
        self.socket.setblocking(False)
        self.sent = 0
        if self.socket.connect_ex(("127.0.0.1", self.port)) not in (0, errno.EINPROGRESS):
            self.leave()
            return
        self.selector.register(self.socket, selectors.EVENT_READ | selectors.EVENT_WRITE, self)

    def leave(self) -> None:
        if self.socket is not None:
            with contextlib.suppress(KeyError):
                self.selector.unregister(self.socket)
            self.socket.close()
            self.socket = None

    def go_on(self, events: int) -> int:
        """Do what can be done; returns how many bytes were taken."""
        assert self.socket is not None
        try:
            if events & selectors.EVENT_READ and not self.socket.recv(65536):
                raise ConnectionResetError
            if events & selectors.EVENT_WRITE and self.kind != "headers":
                self.selector.modify(self.socket, selectors.EVENT_READ, self)
            if not events & selectors.EVENT_WRITE or self.kind == "silent":
                return 0
            return self.say()
        except OSError:
            self.leave()
            self.again_at = time.monotonic() + 1.0
            return 0

    def say(self) -> int:
        assert self.socket is not None
        data = HEAD if self.sent == 0 else HEADERS
        taken = self.socket.send(
            data
            if self.kind == "headers"
            else (HEAD + b"X: " + b"a" * 9999)[self.sent : self.sent + 1]
        )
        self.sent += taken
        return taken


def main(port: int, kind: str, count: int) -> None:
    selector = selectors.DefaultSelector()
    selector.register(sys.stdin, selectors.EVENT_READ, None)
    visitors = [Visitor(port, kind, selector) for _ in range(count)]
    taken, told_at, said_at = 0, time.monotonic(), 0.0
    for each in visitors:
        each.visit()
    print("ready", flush=True)
    while True:
        for key, events in selector.select(0.05):
            if key.data is None:
                return
            taken += key.data.go_on(events)
        now = time.monotonic()
        for each in visitors:
            if each.socket is None and each.again_at <= now:
                each.visit()
        if kind == "slow" and now - said_at >= 0.5:
            said_at = now
            for each in visitors:
                if each.socket is not None and each.sent:
                    taken += each.go_on(selectors.EVENT_WRITE)
        if now - told_at >= 1:
            told_at = now
            print(sum(each.socket is not None for each in visitors), taken, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
