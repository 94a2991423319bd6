"""Outcomes of the samples without an answer: set-points and the stop.

A service says what it has done; a sample says nothing. But the gateway counts what becomes of the
samples of a reliable topic (``@acoustic/1/streams``), so the operator can be told whether the
vehicle has the newest one.
"""

import enum
from typing import Any, Final

_FAILURES: Final = ("expired", "refused", "cancelled")


TAKEN_WITHIN_S: Final = 3.0
"""A running gateway has counted a sample within this; it publishes counts once a second."""


class Fate(enum.Enum):
    """Of the newest sample of a topic."""

    GIVEN = "given to the gateway"
    """The gateway has not counted it yet."""
    NOT_SENT = "NOT SENT: the gateway has not taken it"
    """For too long already; it may take it still."""
    UNDER_WAY = "on its way"
    """It waits for its frame, is under way, or is not acknowledged yet."""
    THERE = "the vehicle has it"
    LOST = "not delivered"
    """The gateway has given up; it may have arrived nevertheless."""

    @property
    def is_over(self) -> bool:
        """Nothing more becomes of it."""
        return self in (Fate.THERE, Fate.LOST)


class Fates:
    """The fate of the newest sample of each topic."""

    def __init__(self) -> None:
        self._fates: dict[str, Fate] = {}
        self._published: dict[str, int] = {}
        """How many the gateway had counted when the newest one was sent."""
        self._counts: dict[str, dict[str, Any]] = {}
        self._given_at_s: dict[str, float] = {}

    def of(self, topic: str) -> Fate | None:
        """Return the fate of the newest sample; None: there is none."""
        return self._fates.get(topic)

    def sent(self, topic: str, now_s: float) -> None:
        """A sample was published; `now_s` is the instant."""
        self._fates[topic] = Fate.GIVEN
        self._given_at_s[topic] = now_s
        self._published[topic] = self._counts.get(topic, {}).get("published", 0)

    def tick(self, now_s: float) -> None:
        """Time has passed: what the gateway should have counted by now was not sent."""
        for topic, fate in self._fates.items():
            if fate is Fate.GIVEN and now_s - self._given_at_s[topic] > TAKEN_WITHIN_S:
                self._fates[topic] = Fate.NOT_SENT

    def take(self, document: dict[str, Any]) -> None:
        """Take the gateway's counters of all streams, each newer than the last ones."""
        for counts in document["streams"]:
            topic = counts["name"]
            before = self._counts.get(topic, {})
            self._counts[topic] = counts
            fate = self._fates.get(topic)
            if fate is None or fate.is_over or "delivering" not in counts:
                continue
            if counts["published"] < self._published[topic]:
                self._fates[topic] = Fate.LOST  # another start of the gateway
            elif counts["delivering"]:
                is_counted = counts["published"] > self._published[topic]
                self._fates[topic] = Fate.UNDER_WAY if is_counted else fate
            elif counts["published"] > self._published[topic]:
                failed = any(counts[each] > before.get(each, 0) for each in _FAILURES)
                self._fates[topic] = Fate.LOST if failed else Fate.THERE
