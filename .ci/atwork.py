"""Run a command; after four silent seconds, print that it is at work and since when.

    python .ci/atwork.py NAME COMMAND [ARGUMENT ...]

NAME stands in that line. Output of the command is passed on as it comes, through a terminal of its
own if ours is one, so colours stay. The exit code is the command's. This file knows nothing of the
project and needs Python alone.
"""

import contextlib
import fcntl
import os
import select
import signal
import subprocess
import sys
import termios
import time
from typing import Final

SILENT_S: Final = 4.0
_ERASE: Final = b"\r\x1b[K"


def main(what: str, *command: str) -> int:
    """Run it and return its exit code."""
    is_terminal = os.isatty(1)
    ours, theirs = os.openpty() if is_terminal else os.pipe()
    if is_terminal:
        size = fcntl.ioctl(1, termios.TIOCGWINSZ, bytes(8))
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, size)
    began_s = time.monotonic()
    process = subprocess.Popen(command, stdout=theirs, stderr=theirs)
    os.close(theirs)
    # Ctrl-C reaches the command as well, which ends in its own way.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    is_shown, last = False, b"\n"
    while True:
        is_ready, _, _ = select.select([ours], [], [], SILENT_S)
        if is_ready:
            data = b""
            with contextlib.suppress(OSError):  # a terminal whose other end is closed
                data = os.read(ours, 1 << 16)
            if not data:
                break
            write((_ERASE if is_shown else b"") + data)
            is_shown, last = False, data[-1:]
            continue
        if process.poll() is not None:
            break  # what it has started holds the other end
        note = f"{what} … {time.monotonic() - began_s:.0f} s".encode()
        if is_terminal and last == b"\n":
            write(_ERASE + note)
            is_shown = True
        elif not is_terminal:
            write((b"" if last == b"\n" else b"\n") + note + b"\n")
            last = b"\n"
    if is_shown:
        write(_ERASE)
    code = process.wait()
    return code if code >= 0 else 128 - code


def write(data: bytes) -> None:
    """Write all of it."""
    with contextlib.suppress(BrokenPipeError):
        while data:
            data = data[os.write(1, data) :]


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
