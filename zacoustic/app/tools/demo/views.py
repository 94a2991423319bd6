"""The views of the demo: `View`, and two that write lines; the live one is in `live`."""

import sys
from abc import ABC, abstractmethod
from typing import assert_never

import msgspec

from zacoustic.app.tools.demo.logbook import Logbook, network_name
from zacoustic.app.tools.demo.notes import AnyNote, Arrived, Crossed, Emitted, Sent, Started
from zacoustic.app.tools.demo.verdict import Summary, as_text
from zacoustic.text.safetext import json_line


class View(ABC):
    """Shows a run of the demo; all calls come from one thread."""

    @abstractmethod
    def begin(self, logbook: Logbook) -> None:
        """Begin a run; `logbook` is kept up to date from now on."""

    @abstractmethod
    def note(self, note: AnyNote) -> None:
        """Something happened."""

    @abstractmethod
    def tick(self) -> None:
        """Some time has passed; called several times a second."""

    @abstractmethod
    def stop(self) -> None:
        """Give the terminal back; called once, also after a failure."""

    @abstractmethod
    def conclude(self, summary: Summary) -> None:
        """The demo is over; called after `stop`, unless it was interrupted."""


class WritingView(View):
    """Writes each note as it happens, and nothing in between."""

    def begin(self, logbook: Logbook) -> None:
        """Write nothing."""

    def tick(self) -> None:
        """Write nothing."""

    def stop(self) -> None:
        """Write nothing."""


class JsonView(WritingView):
    """One JSON object in a line; the last is the summary."""

    def note(self, note: AnyNote) -> None:
        """Write it."""
        _write(json_line(msgspec.to_builtins(note)))

    def conclude(self, summary: Summary) -> None:
        """Write it."""
        _write(json_line(msgspec.to_builtins(summary)))


class LinesView(WritingView):
    """Plain lines, for a log or a simple terminal."""

    def note(self, note: AnyNote) -> None:
        """Write it."""
        _write(f"{note.at_s:7.2f} s  {describe(note)}")

    def conclude(self, summary: Summary) -> None:
        """Write it."""
        _write(f"\n{as_text(summary)}")


def describe(note: AnyNote) -> str:
    """Return a note as one line for people, without its instant."""
    match note:
        case Started():
            return f"{note.child} is ready"
        case Emitted():
            return (
                f"{network_name(note.source)} sends {note.frame_bytes} bytes, "
                f"{note.airtime_s:.3f} s of airtime"
            )
        case Arrived(outcome="received"):
            return (
                f"{network_name(note.target)} has received {note.frame_bytes} bytes "
                f"from {network_name(note.source)}, {note.propagation_s:.3f} s on their way"
            )
        case Arrived():
            return f"{network_name(note.target)} has lost a frame: {note.outcome}"
        case Sent():
            name = network_name(note.source)
            return f"{name}: {note.stream} {note.count} is to cross: {shown(note.value)}"
        case Crossed():
            return (
                f"{note.stream} {note.count} crossed in {note.delay_s:.3f} s: {shown(note.value)}"
            )
        case _:
            assert_never(note)


def shown(value: object) -> str:
    """Return a short form of a value: fields and numbers."""
    if not isinstance(value, dict):
        return str(value)
    return " ".join(
        f"{name} {part:.8g}" if isinstance(part, float) else f"{name} {part}"
        for name, part in value.items()
        if name != "count"
    )


def _write(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()  # the reader of a pipe wants each line at once
