"""Whether every command of the shore has an outcome, delivered or not.

The gateway counts under `@acoustic/1/streams` how each reliable sample ended. A sample that it
lost without a word, or that it counted twice, would show here.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from examples.auv.shore import Answer
from zacoustic.core.engine.events import DeliveryOutcome


def unaccounted(
    published: Mapping[str, int], answers: Iterable[Answer], document: Mapping[str, Any] | None
) -> list[str]:
    """Return what has no outcome, a line each; nothing: all have one.

    Args:
        published: How many samples the shore has put, by stream.
        answers: Of its calls and goals.
        document: The gateway's health document of its streams; None: nothing yet.
    """
    lines = []
    streams = {} if document is None else {each["name"]: each for each in document["streams"]}
    for name, number in published.items():
        counts = streams.get(name, {})
        ended = sum(counts.get(outcome.value, 0) for outcome in DeliveryOutcome)
        if ended != number or counts.get("delivering", 0):
            lines.append(f"{name}: {number} samples, of which {ended} have ended")
    waiting = sum(not answer.ended for answer in answers)
    if waiting:
        lines.append(f"{waiting} calls or goals without an end")
    return lines
