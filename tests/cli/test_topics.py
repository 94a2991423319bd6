"""`zacoustic topic list`, and the documents that it reads: what crosses, how often, how old."""

import json
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from tests.cli.watched import WATCHED, lines_of, pair
from tests.gateway.networkpair import verb
from tests.gateway.networks import cbor, get, hear, run
from zacoustic.app.cli import main
from zacoustic.core.base.linktypes import Service
from zacoustic.core.base.trace import TraceRecord
from zacoustic.zenoh.gateway.notices import notice
from zacoustic.zenoh.gateway.status.recent_events import EVENTS_KEPT, TROUBLES_KEPT, RecentEvents
from zacoustic.zenoh.gateway.status.traffic import EXCHANGES_KEPT, Traffic


def test_topics_tells_what_has_crossed_and_how_old_it_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def scene() -> None:
        async with pair() as found:
            heard = await hear(found.shore, "auv1/nav")
            for depth in (1.0, 2.0, 3.0):
                payload = cbor(depth=depth, mode="survey")
                found.auv.put("auv1/nav", payload, encoding="application/cbor")
                await heard.next()
            assert await verb("topic", "list", "--wide", *found.where, "--json") == 0
            rows = {row["name"]: row for row in lines_of(capsys)}
            nav = rows["auv1/nav"]
            assert (nav["gateway"], nav["id"], nav["kind"]) == (1, 10, "topic")
            assert (nav["heard"], nav["sent"], nav["jobs"]) == (3, 0, ["deliver"])
            assert 0 <= nav["heard_ago_s"] <= nav["age_s"] < 20
            assert nav["heard_rate_hz"] > 0
            assert nav["sent_rate_hz"] is None
            assert rows["auv1/arm"]["heard_ago_s"] is None
            assert rows["auv1/goto"]["kind"] == "action"
            at_auv = ["--connect", f"tcp/127.0.0.1:{found.auv_network.port}"]
            assert await verb("topic", "list", *at_auv, "--node", "2") == 0
            text = capsys.readouterr().out
            assert text.startswith("gateway 2 auv1: link up")
            nav_line = next(line for line in text.splitlines() if "auv1/nav" in line)
            assert nav_line.split()[:4] == ["10", "auv1/nav", "out", "3"]
            assert await verb("topic", "list", *at_auv, "--node", "7") == 1
            assert "gateway 7 is not on this network; there are: 2" in capsys.readouterr().err

    run(scene())


def test_gateway_tells_its_events_exchanges_and_clock() -> None:
    async def scene() -> None:
        ranges = WATCHED | {"ranging": [{"by": 1, "to": 2, "every_s": 1}]}
        async with pair(section=ranges) as found:
            heard = await hear(found.shore, "chat")
            found.auv.put("chat", b"here")  # so that the two have met
            await heard.next()
            found.shore.put("chat", b"x" * 10_000)  # fits no frame
            key = "@acoustic/1/events"
            while True:
                replies = await get(found.shore, "@acoustic/1/**")
                events = json.loads(replies.payload(key))["events"]
                peers = json.loads(replies.payload("@acoustic/1/peers"))
                has_complained = any(each["event"] == "input_error" for each in events)
                if has_complained and peers.get("2", {}).get("delivered"):
                    break
            # Two modems that speak at one moment lose a message, and that is told, too.
            lost, arrived = peers["2"]["not_delivered"], peers["2"]["delivered"]
            assert peers["2"]["per"] == pytest.approx(lost / (lost + arrived), abs=1e-3)
            assert {"link", "peer"} <= {each["event"] for each in events}
            input_error = next(each for each in events if each["event"] == "input_error")
            assert input_error["trouble"]
            assert input_error["text"].startswith("chat: ")
            node = json.loads(replies.payload("@acoustic/1/node"))
            assert (node["address"], node["name"], node["wire"]) == (1, "shore", "native")
            clock = json.loads(replies.payload("@acoustic/1/clock"))
            assert clock["now_unix_s"] >= node["started_at_unix_s"]
            link = json.loads(replies.payload("@acoustic/1/link"))
            assert link["silent"] is False

    run(scene())


def test_topics_without_a_gateway_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    from tests.gateway.networks import zenoh_router

    with zenoh_router() as port:
        assert main(["topic", "list", "--connect", f"tcp/127.0.0.1:{port}"]) == 1
    assert "no gateway is on this network (is it running" in capsys.readouterr().err
    assert main(["topic", "list", "--node", "255"]) == 2


def record(
    what: str, *, peer: int = 2, streams: tuple[int, ...] = (), detail: str = ""
) -> TraceRecord:
    return TraceRecord(at=0, node=1, what=what, peer=peer, streams=streams, detail=detail)


def test_traffic_keeps_instants_mean_times_and_what_became_of_frames() -> None:
    now = 1000.0
    traffic = Traffic(lambda: now)
    assert traffic.of_stream(10)["sent_at_unix_s"] is None
    traffic.note(record("transmit", streams=(10, 10, 11)))
    assert traffic.of_stream(10)["sent_period_s"] is None
    now = 1006.0
    traffic.note(record("transmit", streams=(10, 10)))
    told = traffic.of_stream(10)
    assert (told["sent_at_unix_s"], told["sent_period_s"]) == (1006.0, 3.0)
    assert traffic.of_stream(11)["sent_period_s"] is None
    traffic.note(record("receive", peer=3, streams=(12,)))
    traffic.note(record("receive", peer=0, streams=(12,)))
    assert traffic.heard_at_unix_s() == {3: 1006.0}
    sample: Any = SimpleNamespace(stream_id=12, age_s=4.5)
    traffic.note_sample(sample)
    assert traffic.of_stream(12)["age_s"] == 4.5
    sample.age_s = None
    traffic.note_sample(sample)
    assert traffic.of_stream(12)["age_s"] is None


def test_what_came_from_a_node_is_counted_by_link() -> None:
    traffic = Traffic(lambda: 0.0)
    heard = TraceRecord(at=0, node=1, what="receive", peer=2, size_bytes=5, link="acoustic")
    for link, size_bytes in (("radio", 10), ("radio", 20), ("acoustic", 5)):
        traffic.note(replace(heard, size_bytes=size_bytes, link=link))
    traffic.note(replace(heard, size_bytes=900, service=Service.BULK))
    assert traffic.received_from(2) == {
        "radio": {Service.PLAIN: (2, 30)},
        "acoustic": {Service.PLAIN: (1, 5), Service.BULK: (1, 900)},
    }
    assert traffic.received_from(3) == {}


def test_error_rate_is_that_of_the_last_frames_to_each_node() -> None:
    traffic = Traffic(lambda: 0.0)
    for peer, outcome in ((2, "not_delivered"), (3, "delivered"), (255, "sent")):
        traffic.note(record("transmit", peer=peer))
        traffic.note(record("report", peer=0, detail=outcome))
    assert traffic.of_peer(2) == {"delivered": 0, "not_delivered": 1, "per": 1.0}
    assert traffic.of_peer(3)["per"] == 0.0
    assert traffic.of_peer(255)["per"] is None
    for number in range(EXCHANGES_KEPT):
        traffic.note(record("transmit"))
        traffic.note(record("report", detail="not_delivered" if number % 4 == 0 else "delivered"))
    assert traffic.of_peer(2)["per"] == 0.25
    assert traffic.of_peer(2)["not_delivered"] == EXCHANGES_KEPT / 4 + 1


def events_of(recent_events: RecentEvents) -> list[Any]:
    document: Any = msgspec.to_builtins(recent_events.documents()["events"])
    events: list[Any] = document["events"]
    return events


def test_recent_events_keep_the_last_and_troubles_longer() -> None:
    recent_events = RecentEvents(lambda: 5.0)
    for _ in range(EVENTS_KEPT):
        recent_events.note(notice("link", "up", state="up"))
    recent_events.note(notice("router", "lost", is_trouble=True, state="lost"))
    recent_events.input_error("x" * 1000)
    events = events_of(recent_events)
    assert len(events) == EVENTS_KEPT
    assert [each["trouble"] for each in events[-3:]] == [False, True, True]
    assert events[-2] == {
        "at_unix_s": 5.0,
        "event": "router",
        "trouble": True,
        "text": "router lost",
    }
    assert len(events[-1]["text"]) == 200
    for _ in range(EVENTS_KEPT):
        recent_events.note(notice("link", "up", state="up"))
    events = events_of(recent_events)
    assert [each["trouble"] for each in events] == [True, True] + [False] * EVENTS_KEPT
    for _ in range(2 * EVENTS_KEPT):
        recent_events.input_error("no")
    events = events_of(recent_events)
    assert len(events) == EVENTS_KEPT + TROUBLES_KEPT
