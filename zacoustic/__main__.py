"""The start of the command line: the program `zacoustic`, and `python -m zacoustic`.

Ctrl-C says nothing but ends the program, from its first instruction to its last: while modules are
imported, and when the verb has ended, the signal has the default action of the system; while a verb
runs it is a `KeyboardInterrupt`, which the verb may have something to do for.
"""

import signal


def _leave_interrupts_to_the_system() -> bool:
    """Return whether they were Python's; a shell's background job has them ignored, and that stays.

    What Python would do prints a traceback wherever an import happens to be.
    """
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return ours


_TAKES_INTERRUPTS = _leave_interrupts_to_the_system()

import sys  # noqa: E402 (from here on an interrupt is harmless)

from zacoustic.app.cli import main  # noqa: E402
from zacoustic.app.cli.support.streams import prepare_streams  # noqa: E402
from zacoustic.link.command import EXIT_INTERRUPTED  # noqa: E402


def start() -> int:
    """Run the command line with the arguments of the process; returns the exit code."""
    prepare_streams()
    sys.unraisablehook = _die_of_lost_interrupt
    try:
        if _TAKES_INTERRUPTS:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        return main()
    except KeyboardInterrupt:  # beside the verb
        return EXIT_INTERRUPTED
    finally:
        _leave_interrupts_to_the_system()


def _die_of_lost_interrupt(lost: "sys.UnraisableHookArgs") -> None:
    """An interrupt that fell into a callback of the interpreter would be printed and lost."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.raise_signal(signal.SIGINT)
    sys.__unraisablehook__(lost)


if __name__ == "__main__":
    sys.exit(start())
