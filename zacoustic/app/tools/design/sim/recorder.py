"""Recordings of simulations: all engines of a virtual network in one file."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from zacoustic.errors import ConfigError
from zacoustic.run.recording.recorder import EngineRecorder
from zacoustic.run.recording.writing import MessageSink, RecordingFile
from zacoustic.testing.virtual import VirtualNetwork
from zacoustic.testing.virtualclock import WALL_BEGINS_NS


class SimulationRecorder(EngineRecorder):
    """Records the engines of a virtual network, whose time began at `WALL_BEGINS_NS`.

    Args:
        sink: Takes the messages.
    """

    def __init__(self, sink: MessageSink) -> None:
        super().__init__(sink, self._offset)
        self.network: VirtualNetwork | None = None
        """The network; None before it exists."""

    def _offset(self, address: int) -> int:
        if self.network is None:
            return WALL_BEGINS_NS
        return WALL_BEGINS_NS + self.network.now - self.network.local_ns(address)


@contextlib.contextmanager
def recorded_to(path: Path | None) -> Iterator[SimulationRecorder | None]:
    """Yield a recorder of a simulation to a file; None without a file.

    Raises:
        ConfigError: The file exists, or cannot be made or finished.
    """
    if path is None:
        yield None
        return
    if path.exists() and not path.is_dir():
        hint = "give another name, or move that away"
        raise ConfigError(f"recording {path} exists; allowed: a new file", hint=hint)
    file = RecordingFile(path, waits=True)
    try:
        recorder = SimulationRecorder(file)
        try:
            yield recorder
        except ConfigError:  # nothing has run, so there is nothing to read in it
            file.path.unlink(missing_ok=True)
            raise
        recorder.finish()
    finally:
        file.close()
