"""Beside a large object on its way the other node is heard soon, and DESERT loses little."""

import statistics
from collections.abc import Callable
from functools import partial

from tests.links.desert.desert_virtual import VirtualDesert
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.engine.events import DeliveryEnded, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

PHOTO, REPORT = 1, 2
PHOTO_BYTES = 6000
TABLE = StreamTable(
    [
        TopicSpec(
            stream_id=PHOTO,
            name="photo",
            publishers=(1,),
            subscribers=(2,),
            qos=Qos(reliability=Reliability.RELIABLE, priority=Priority.BACKGROUND),
        ),
        TopicSpec(stream_id=REPORT, name="report", publishers=(2,), qos=Qos(depth=100)),
    ],
    nodes={1: "auv", 2: "shore"},
)


def delays_beside_an_object(seed: int) -> tuple[list[float], float]:
    """Return how late reports are beside a photo, s, and which share of the packets is lost."""
    desert = VirtualDesert(TABLE, seed=seed)
    for address, stream_id in ((1, PHOTO), (2, REPORT)):  # they meet
        desert.at(10.0 * address, partial(desert.publish, address, stream_id, b"met"))
    published_at: dict[bytes, int] = {}

    def report(number: int) -> None:
        sample = b"%040d" % number
        published_at[sample] = desert.agenda.now
        desert.publish(2, REPORT, sample)

    desert.at(60.0, partial(desert.publish, 1, PHOTO, bytes(range(250)) * (PHOTO_BYTES // 250)))
    for number in range(20):
        desert.at(65.0 + 2.7 * number, partial(report, number))
    desert.run(until_s=1000.0)
    ended_at = [at for at, _, event in desert.events if isinstance(event, DeliveryEnded)]
    assert len(ended_at) == 2, "the photo arrives, too"
    delays_s = [
        (at - published_at[event.value]) / 1e9
        for at, address, event in desert.events
        if address == 1 and isinstance(event, SampleReceived) and event.value in published_at
    ]
    sent = desert.desert.counts["sent"]
    return delays_s, desert.desert.counts["lost"] / sent


def test_reports_are_soon_there_beside_an_object(count: Callable[[int], int]) -> None:
    arrived: list[int] = []
    for seed in range(count(300)):
        delays_s, lost = delays_beside_an_object(seed)
        arrived.append(len(delays_s))
        assert len(delays_s) >= 15, seed
        assert statistics.median(delays_s) <= 2.0, (seed, sorted(delays_s))
        assert lost <= 0.1, (seed, lost)
    assert statistics.fmean(arrived) >= 18
