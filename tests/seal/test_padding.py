"""Frames of a padded fleet: every length is a listed one, or the longest that all nodes hear."""

import random

import pytest

from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkState,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import new_key

S2C = LinkCapabilities(
    mtu_bytes=200, bit_rate_bps=1000, addressed=True, checked=True, framed=True,
    broadcast_mtu_bytes=64,
)  # fmt: skip
"""A broadcast frame has less room than one for a single node."""


def lengths(pads: tuple[int, ...]) -> dict[int, int]:
    """Publish for all nodes and for node 2; return the length of the frame by destination."""
    engine = Engine(
        address=1,
        table=StreamTable([
            TopicSpec(stream_id=1, name="all"),
            TopicSpec(stream_id=2, name="two", subscribers=(2,)),
        ]),
        epoch=1,
        rng=random.Random(1),
        rules=TransmitRules(sealing=SealRules(pad_bytes=pads)),
        cipher=FleetCipher(new_key("test")),
    )  # fmt: skip
    engine.handle_link_state(LinkState.UP, 0, S2C)
    now, found = 0, {}
    for stream_id in (1, 2):
        engine.publish(stream_id, bytes(8), now)
        while (sent := engine.poll_transmit(now)) is None:
            while (write := engine.poll_journal()) is not None:
                engine.handle_journal_committed(write.write_id, now)
            now = max(now, engine.poll_timeout() or now)
            engine.handle_timeout(now)
        found[sent.destination] = len(sent.frame_bytes)
        report = TransmitReport(
            transmission_id=sent.transmission_id, outcome=TransmitOutcome.SENT, started_at=now,
            finished_at=now,
        )  # fmt: skip
        engine.handle_transmit_report(report, now)
    return found


@pytest.mark.parametrize(
    ("pads", "to_all", "to_one"), [((48, 150), 48, 48), ((150,), 64, 150), ((64, 150), 64, 64)]
)
def test_padding_leaves_a_broadcast_frame_one(
    pads: tuple[int, ...], to_all: int, to_one: int
) -> None:
    assert lengths(pads) == {BROADCAST: to_all, 2: to_one}
