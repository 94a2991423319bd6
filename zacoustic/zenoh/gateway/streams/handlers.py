"""The streams of a gateway, by their kind."""

from collections.abc import Mapping

from zacoustic.core.engine.engine import Engine
from zacoustic.zenoh.gateway.streams.actions import Actions
from zacoustic.zenoh.gateway.streams.matching import MatchingSubscribers
from zacoustic.zenoh.gateway.streams.services import Services
from zacoustic.zenoh.gateway.streams.topics import Topics


class StreamHandlers:
    """Topics, services and actions; for the loop.

    Args:
        topics: Samples, both ways.
        services: Calls, both ways.
        actions: Goals, both ways.
        matching: Watches local subscribers of on-demand topics.
    """

    def __init__(
        self, topics: Topics, services: Services, actions: Actions, matching: MatchingSubscribers
    ) -> None:
        self.topics = topics
        self.services = services
        self.actions = actions
        self.matching = matching

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the samples for late joiners from before the restart."""
        self.topics.recover(stored)

    def drain(self, engine: Engine, now: int) -> None:
        """Give the engine the local samples."""
        self.topics.drain(engine, now)

    def close(self) -> None:
        """Stop asking the local network."""
        self.topics.intake.close()
        self.matching.close()
        self.services.close()
        self.actions.close()
