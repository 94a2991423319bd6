"""The recording of one running node: opened before its engine is made, closed after it."""

import asyncio
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from zacoustic.core.base.clock import Clock
from zacoustic.ros.streams import RosStream
from zacoustic.run.inbox import tell_loop
from zacoustic.run.recording.recorder import EngineRecorder
from zacoustic.run.recording.writing import RecordingFile


class LiveRecording:
    """Makes the recorded engine of a node; used on the loop.

    Args:
        file: The file, open; closed with this object.
        clock: Source of the engine's instants.
        ros: The ROS types of streams by id.
    """

    def __init__(
        self,
        file: RecordingFile,
        *,
        clock: Clock = time.monotonic_ns,
        ros: Mapping[int, RosStream] | None = None,
    ) -> None:
        self._file = file
        self._recorder = EngineRecorder(file, lambda address: time.time_ns() - clock(), ros=ros)
        self.make = self._recorder.make
        """Makes the engine; a `MakeEngine`."""

    @property
    def path(self) -> Path:
        """The file: the given name, with the time added if that existed."""
        return self._file.path

    @property
    def dropped(self) -> int:
        """Messages missing from the file because the disk was too slow or full."""
        return self._file.dropped

    async def close(self) -> None:
        """Finish the file, off the loop; the engine must not be called any more."""
        self._recorder.finish()
        await asyncio.to_thread(self._file.close)


async def open_recording(
    path: str | Path,
    *,
    clock: Clock = time.monotonic_ns,
    ros: Mapping[int, RosStream] | None = None,
    trouble: Callable[[str], None] | None = None,
) -> LiveRecording:
    """Open a recording, off the loop.

    Args:
        path: The file.
        clock: Source of the engine's instants.
        ros: The ROS types of streams by id.
        trouble: Called on the loop with gaps and their reasons; None: they are logged.

    Raises:
        ConfigError: The file cannot be made, or the extra is missing.
    """
    loop = asyncio.get_running_loop()

    def tell(text: str) -> None:
        if trouble is not None:
            tell_loop(loop, partial(trouble, text))

    told = tell if trouble is not None else None
    file = await asyncio.to_thread(RecordingFile, path, trouble=told)
    return LiveRecording(file, clock=clock, ros=ros)
