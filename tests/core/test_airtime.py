"""Airtime caps: a share of the time, over any long time."""

import random

import pytest

from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.airtime import AirtimeAccount
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

S = NS_PER_S
LINK = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, preamble_s=0.2)


def test_account_lets_go_until_it_is_in_the_red_and_waits_for_the_share() -> None:
    account = AirtimeAccount(0.1)
    assert account.even_at(0) == 0
    account.spend(61 * S, 0)  # ten minutes' share, and a second
    assert account.even_at(0) == pytest.approx(10 * S, abs=2)
    assert account.even_at(5 * S) == pytest.approx(10 * S, abs=2)
    assert account.even_at(11 * S) == 11 * S


def test_account_saves_no_more_than_ten_minutes() -> None:
    account = AirtimeAccount(0.1)
    account.spend(61 * S, 10**6 * S)
    assert account.even_at(10**6 * S) == pytest.approx(10**6 * S + 10 * S, abs=2)


def saturated(
    *, caps: dict[int, float | None], total: float | None = None, hours: float = 6.0
) -> tuple[dict[int, float], int]:
    """Offer more than fits of each stream for hours; returns each one's share of the time."""
    table = StreamTable(
        [
            TopicSpec(
                stream_id=stream_id,
                name=f"t{stream_id}",
                qos=Qos(
                    depth=3,
                    max_airtime=share,
                    priority=Priority.REAL_TIME if stream_id == 9 else Priority.DATA,
                ),
            )
            for stream_id, share in caps.items()
        ]
    )
    engine = Engine(
        address=1, table=table, epoch=1, rng=random.Random(1),
        rules=TransmitRules(max_airtime=total),
    )  # fmt: skip
    while (write := engine.poll_journal()) is not None:
        engine.handle_journal_committed(write.write_id, 0)
    engine.handle_link_state(LinkState.UP, 0, LINK)
    used = dict.fromkeys(caps, 0)
    urgent = now = 0
    while now < hours * 3600 * S:
        for stream_id in caps:
            if stream_id != 9:
                engine.publish(stream_id, bytes(40), now)
        if 9 in caps and now // (60 * S) != urgent:
            urgent = now // (60 * S)
            engine.publish(9, bytes(40), now)
        sent = engine.poll_transmit(now)
        if sent is None:
            due_at = engine.poll_timeout()
            assert due_at is not None
            assert due_at > now
            now = min(due_at, (now // (60 * S) + 1) * 60 * S)
            engine.handle_timeout(now)
            continue
        airtime_ns = LINK.airtime_ns(len(sent.frame_bytes))
        (stream_id,) = [each for each in caps if each in sent.frame_bytes[:12]][:1] or [0]
        used[stream_id] += airtime_ns
        report = TransmitReport(
            transmission_id=sent.transmission_id,
            outcome=TransmitOutcome.SENT,
            started_at=now,
            finished_at=now + airtime_ns,
        )
        now += airtime_ns
        engine.handle_transmit_report(report, now)
    return {each: ns / now for each, ns in used.items()}, now


def test_capped_stream_gets_its_share_and_the_other_one_the_rest() -> None:
    shares, _ = saturated(caps={33: 0.1, 34: None}, hours=4.0)
    assert 0.08 < shares[33] < 0.105
    assert shares[34] > 0.6  # pauses of listen windows go off


def test_node_keeps_its_cap() -> None:
    shares, _ = saturated(caps={33: None, 34: None}, total=0.2)
    assert 0.19 < sum(shares.values()) < 0.207  # what was saved up comes on top


@pytest.mark.parametrize("share", [0.0, -0.1, 1.1])
def test_share_out_of_range_is_refused(share: float) -> None:
    with pytest.raises(
        ValueError, match=r"max_airtime is .*; allowed: a share, above 0, at most 1"
    ):
        Qos(max_airtime=share)
