"""Latched topics on Zenoh: a publisher with a cache, a subscriber that asks for its content.

Zenoh's advanced subscriber with a history, such as a *transient local* subscription of rmw_zenoh,
asks the caches of publishers, each under ``KEY/@adv/pub/…``. Zenoh's advanced publisher has such a
cache. It needs samples with time stamps: if the file turns those off, there is no cache, and a
warning is logged.
"""

import json
import logging
from collections.abc import Callable

import zenoh
import zenoh.ext

from zacoustic.core.base.qos import Priority
from zacoustic.zenoh.session.session import ZenohSession, one_line, zenoh_priority

_logger = logging.getLogger(__name__)

Latched = zenoh.ext.AdvancedPublisher | zenoh.Publisher
"""A publisher with a cache, or without one if a cache is impossible."""


def stamp_samples(settings: zenoh.Config) -> None:
    """Enable time stamps, which caches need, unless the file has its own setting."""
    if json.loads(settings.get_json("timestamping/enabled")) is None:
        everywhere = {"router": True, "peer": True, "client": True}
        settings.insert_json5("timestamping/enabled", json.dumps(everywhere))


def latched_publisher(
    zenoh_session: ZenohSession, key: str, depth: int, priority: Priority
) -> Latched:
    """Declare a publisher that keeps its last samples for late joiners.

    Args:
        zenoh_session: The session.
        key: Key of the publisher.
        depth: Number of samples that it keeps.
        priority: Priority of its samples.
    """
    try:
        return zenoh.ext.declare_advanced_publisher(
            zenoh_session.session,
            zenoh.KeyExpr(key),
            priority=zenoh_priority(priority),
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
            cache=zenoh.ext.CacheConfig(max_samples=depth),
            publisher_detection=True,
        )
    except zenoh.ZError as error:
        _logger.warning("%s: late joiners get nothing: %s", key, one_line(error))
        return zenoh_session.session.declare_publisher(
            zenoh.KeyExpr(key),
            priority=zenoh_priority(priority),
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
        )


def latched_subscriber(
    zenoh_session: ZenohSession, expression: str, take: Callable[[zenoh.Sample], None], depth: int
) -> "zenoh.ext.AdvancedSubscriber[None]":
    """Declare a subscriber that also gets the samples of caches.

    Args:
        zenoh_session: The session.
        expression: Keys of the subscriber.
        take: Receives samples, on a thread of Zenoh.
        depth: Number of earlier samples to request from each publisher.
    """
    return zenoh.ext.declare_advanced_subscriber(
        zenoh_session.session,
        zenoh.KeyExpr(expression),
        zenoh_session.callback(take),
        allowed_origin=zenoh.Locality.REMOTE,
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=depth),
    )
