"""The signature of a constructor of engines, for code that replaces it: a recorder, a test."""

import random
from collections.abc import Mapping
from typing import Protocol

from zacoustic.core.base.trace import TraceSink
from zacoustic.core.engine.engine import Engine
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable


class MakeEngine(Protocol):
    """Makes the engine for one start of a node; `Engine` itself does."""

    def __call__(
        self,
        *,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        rules: TransmitRules,
        stored: Mapping[str, bytes],
        trace: TraceSink | None,
    ) -> Engine:
        """Return a new engine."""
        ...
