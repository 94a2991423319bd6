"""The common part of verbs that measure recorded telemetry."""

from typing import Final

from zacoustic.app.cli.support.rows import option, seconds, word
from zacoustic.app.cli.support.verb import Verb

_WINDOW_S: Final = 10.0
"""Time within which samples usually share a frame, s."""


class Telemetry(Verb):
    """A verb that takes recordings of telemetry, and the streams."""

    recordings: list[str] = word(
        "RECORDING",
        'MCAP, or JSON lines, also compressed: {"t": seconds, "s": topic, "v": value}',
        "+",
    )
    config: str = option("FILE", "file with the streams and types", required=True)
    window: float = seconds("samples within this time share a frame, s", _WINDOW_S)
