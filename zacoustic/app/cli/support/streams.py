"""Standard input, output and error in any state: closed, full, or with another encoding.

A closed stream is replaced by the null device, also for libraries: otherwise the next opened file,
a recording or a socket, would get its descriptor and all printed text. Characters that an encoding
lacks are written as JSON escapes.
"""

import codecs
import contextlib
import io
import os
import sys
from typing import Final

UNREAD: Final = "nobody reads the output"
"""Reason when a reader has closed the pipe, as `head` does: no fault."""
_ESCAPES: Final = "zacoustic.escapes"
_NAMES: Final = ("stdin", "stdout", "stderr")


def prepare_streams() -> None:
    """Make the three streams of the process usable, whatever their state."""
    codecs.register_error(_ESCAPES, _escape)
    for descriptor, name in enumerate(_NAMES):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free descriptor, which is this one
        if getattr(sys, name) is None:
            mode = "r" if name == "stdin" else "w"
            # The stream of the process: it is never closed.
            setattr(sys, name, open(descriptor, mode, encoding="utf-8", closefd=False))  # noqa: SIM115
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace" if name == "stdin" else _ESCAPES)


def flush_output() -> str:
    """Flush the output; return the reason if that is not possible, one line, else nothing.

    After a failure further output is discarded: the interpreter flushes again at exit.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence_output()
        return UNREAD
    except (OSError, ValueError) as error:
        silence_output()
        return str(getattr(error, "strerror", None) or error)
    return ""


def silence_output() -> None:
    """Redirect standard output to the null device."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _escape(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    units = text.encode("utf-16-be", "surrogatepass").hex(" ", 2).split()
    return "".join(f"\\u{unit}" for unit in units), error.end
