"""The document about dropped data: receptions, local input, samples that waited too long."""

from collections import Counter

from zacoustic.run.runner import LinkRunner
from zacoustic.status.node import DroppedDocument
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.gateway.streams.intake import Intake
from zacoustic.zenoh.session.asking.queries import QueryHandler
from zacoustic.zenoh.session.session import ZenohSession

Counts = dict[str, dict[str, int]]
"""Number by stream and reason."""


class Dropped:
    """The document ``dropped`` of one gateway.

    Args:
        runner: Runs the engine.
        input_errors: Counts the errors of local input.
        intake: Counts local samples that were dropped.
        queries: Counts queries that were refused as too many.
        zenoh_session: Counts puts that the session refused.
    """

    def __init__(
        self,
        runner: LinkRunner,
        input_errors: InputErrors,
        intake: Intake,
        queries: QueryHandler,
        zenoh_session: ZenohSession,
    ) -> None:
        self._runner = runner
        self._input_errors = input_errors
        self._intake = intake
        self._queries = queries
        self._zenoh_session = zenoh_session

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key."""
        engine = self._runner.engine
        return {
            "dropped": DroppedDocument(
                channel=dict(engine.stats.dropped),
                local=self._of_local_input(),
                expired=self._by_name(engine.expired),
                superseded=self._by_name(self._superseded()),
                unsubscribed=self._by_name(engine.stats.unsubscribed),
            )
        }

    def _of_local_input(self) -> Counts:
        found = {name: dict(counts) for name, counts in self._input_errors.counts.items()}
        for name, count in self._by_name(self._intake.oversized()).items():
            found.setdefault(name, {})["oversized"] = count
        if self._queries.refused:
            found["queries"] = {"refused": self._queries.refused}
        if self._zenoh_session.lost:
            found["session"] = {"lost": self._zenoh_session.lost}
        return found

    def _superseded(self) -> dict[int, int]:
        """Return the samples that newer ones have replaced, in the engine or before it."""
        total = Counter(self._runner.engine.superseded)
        total.update(self._intake.superseded())
        return dict(total)

    def _by_name(self, counts: dict[int, int]) -> dict[str, int]:
        table = self._runner.engine.table
        named = ((table.get(stream_id), count) for stream_id, count in counts.items())
        return {"" if stream is None else stream.name: count for stream, count in named}
