"""`zacoustic status`, `nodes`, `topic hz`, `bw`, `info` and `stream NAME` beside two gateways."""

import asyncio
import json
from typing import Any

import msgspec
import pytest

from tests.cli.watched import lines_of, pair
from tests.gateway.networkpair import verb
from tests.gateway.networks import cbor, hear, run
from zacoustic.app.tools.columns import shortened, shortened_apart
from zacoustic.app.tools.field.rates import RateMeter
from zacoustic.app.tools.watch.statustext import (
    goes_well,
    nodes_text,
    status_of,
    status_text,
)
from zacoustic.app.tools.watch.topicstext import streams_text
from zacoustic.app.tools.watch.views import (
    CarriedView,
    CarryView,
    GatewayView,
    LinkView,
    PeerView,
    StreamView,
    WaitsView,
)
from zacoustic.status.node import ModemDocument

WIDTH = 80
LONG = "a/very/long/key/of/a/vehicle/with/many/chunks/of/words"


def test_status_nodes_and_topics_tell_what_gateways_know(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def scene() -> None:
        async with pair() as found:
            heard = await hear(found.shore, "auv1/nav")
            at_auv = ("--connect", f"tcp/127.0.0.1:{found.auv_network.port}")
            hz = asyncio.create_task(
                verb("topic", "hz", "auv1/nav", *found.where, "--timeout", "3", "--json")
            )
            bw = asyncio.create_task(
                verb("topic", "bw", "auv1/nav", *at_auv, "--timeout", "4", "--json")
            )
            await asyncio.sleep(1.5)  # both have subscribed
            for depth in (1.0, 2.0, 3.0):
                payload = cbor(depth=depth, mode="survey")
                found.auv.put("auv1/nav", payload, encoding="application/cbor")
                await heard.next()
            assert (await hz, await bw) == (0, 0)
            measured = lines_of(capsys)
            rate = next(each for each in measured if "rate_hz" in each)
            assert 2 <= rate["samples"] <= 3
            assert rate["rate_hz"] > 0
            of_air = next(each for each in measured if "bytes_per_s" in each)
            assert of_air["samples"] >= 1
            assert of_air["bytes"] > of_air["samples"]

            assert await verb("status", *found.where) == 0
            lines = capsys.readouterr().out.splitlines()
            assert lines[0].startswith("gateway 1 shore: link up")
            assert len(lines) <= 10
            assert any("node     2 auv1: " in line and " ago" in line for line in lines)
            assert await verb("status", *found.where, "--json") == 0
            (status,) = lines_of(capsys)
            assert status["is_well"]
            assert [node["address"] for node in status["nodes"]] == [2]

            assert await verb("nodes", *found.where, "--json") == 0
            (node,) = lines_of(capsys)
            assert (node["gateway"], node["address"], node["name"]) == (1, 2, "auv1")
            assert await verb("nodes", *found.where) == 0
            assert "\n   2  auv1 " in capsys.readouterr().out

            for noun, kinds in (("topic", {"topic"}), ("action", {"action"})):
                assert await verb(noun, "list", *found.where, "--json") == 0
                assert {row["kind"] for row in lines_of(capsys)} == kinds
            assert await verb("topic", "info", "auv1/nav", *found.where) == 0
            info = capsys.readouterr().out
            assert info.startswith("auv1/nav (stream 10, topic)\n")
            assert "heard      3, last " in info
            assert await verb("topic", "info", "no/such", *found.where) == 1
            assert "no gateway here has a stream no/such" in capsys.readouterr().err
            assert await verb("stream", "auv1/nav", "--node", "2", *found.where, "--json") == 0
            assert lines_of(capsys)[0]["stream"] == 10
            assert await verb("stream", "no/such", "--node", "2", *found.where) == 2
            assert "STREAM no/such; allowed: " in capsys.readouterr().err

    run(scene())


def stream(**more: Any) -> StreamView:
    values: dict[str, Any] = {
        "id": 10, "name": "auv1/nav", "kind": "topic", "jobs": (), "published": 0, "sent": 0,
        "heard": 0, "sent_ago_s": None, "heard_ago_s": None, "sent_rate_hz": None,
        "heard_rate_hz": None, "age_s": None, "waiting": 0, "outcomes": {}, "useless": 0,
        "expired": 0, "refused": 0, "airtime_bytes": 0, "airtime_share": 0.0, "differs_at": (),
    }  # fmt: skip
    return StreamView(**values | more)


def peer(**more: Any) -> PeerView:
    values: dict[str, Any] = {
        "address": 2, "name": "auv1", "heard_ago_s": 4.0, "is_lost": False, "same_table": True,
        "snr_db": 18.1, "received_level_db": None, "integrity": None, "range_m": 1234.5,
        "propagation_s": None, "range_ago_s": 9.0, "per": 0.125, "exchanges": 8, "late": (),
        "link": None, "received": None,
    }  # fmt: skip
    return PeerView(**values | more)


def gateway(streams: list[StreamView], peers: list[PeerView], **more: Any) -> GatewayView:
    link: dict[str, Any] = {
        "state": "up",
        "frames_sent": 1,
        "frames_heard": 2,
        "bytes_sent": 3,
        "airtime_s": 1.0,
    }
    of_link = {each: more.pop(each) for each in ("state", "is_silent", "waits") if each in more}
    whole = LinkView(**link | of_link)
    values: dict[str, Any] = {
        "unix_s": 0.0, "address": 1, "name": "shore", "is_alive": True, "gone_s": None,
        "uptime_s": 60.0, "wire": "native", "link": "sim/127.0.0.1:7000", "links": (),
        "routes": (), "hops": (), "bonds": (), "modem": ModemDocument(), "journal": "kept",
        "digest": "", "frames_damaged": 1, "utilisation": 0.1, "window_s": 60.0, "waiting": 3,
        "causes": (), "transfers": (), "transmitting": None, "frames": (), "dropped": {},
        "events": (),
    }  # fmt: skip
    values |= {"whole": whole, "streams": tuple(streams), "peers": tuple(peers)}
    return GatewayView(**values | more)


def test_a_status_names_what_fails_and_stays_short() -> None:
    streams = [
        stream(id=each, name=f"{LONG}/{each}", refused=each, outcomes={"unknown": 1})
        for each in range(1, 9)
    ]
    streams.append(stream(id=50, name="auv1/photo", differs_at=(2,)))
    peers = [peer(address=each, heard_ago_s=None, is_lost=True) for each in range(2, 9)]
    view = gateway(streams, [*peers, peer(address=9)])
    lines = status_text(view).splitlines()
    assert len(lines) <= 13
    assert max(map(len, lines)) <= WIDTH
    assert next(line for line in lines if "node " in line).startswith("  node     9 auv1: 4.0 s")
    assert next(line for line in lines if "fails" in line).startswith("  fails    auv1/photo: diff")
    assert [line.strip() for line in lines if "more:" in line] == [
        "and 4 more: zacoustic nodes", "and 6 more: zacoustic topic list",
    ]  # fmt: skip
    status = status_of(view)
    assert not status["is_well"]
    assert [each["is_stopped"] for each in status["failing"]] == [True] + [False] * 8


def test_a_status_says_why_the_next_frame_waits() -> None:
    def waiting(**more: object) -> list[str]:
        lines = status_text(gateway([], [], **more)).splitlines()
        return [line for line in lines if "wait" in line]

    assert waiting() == ["  waiting  3 samples, calls and goals"]
    slot = WaitsView(why="slot", left_s=3.21)
    assert waiting(waits=slot) == [
        "  waiting  3 samples, calls and goals; next frame waits: slot, 3.2 s more"
    ]
    carrier = WaitsView(why="carrier", left_s=None)
    assert waiting(waits=carrier, waiting=0) == ["  waiting  next frame waits: carrier"]
    assert waiting(waiting=0) == []


def test_a_status_tells_what_waits_who_has_it_and_whether_that_node_is_heard() -> None:
    log: dict[str, Any] = {"stream": "auv1/log", "own": {5: 3}, "custodians": {2: 2}, "carried": {},
           "carried_bytes": 0, "oldest_s": 7300.0, "ends_in_s": 79_000.0}  # fmt: skip
    theirs = log | {"stream": LONG, "own": {}, "custodians": {}, "carried": {1: 9},
                    "carried_bytes": 340}  # fmt: skip
    carry = CarryView(
        own=3, in_custody=2, carried=9, carried_bytes=340, max_bytes=500, refused=0, expired=4,
        streams=tuple(CarriedView(**each) for each in (log, theirs, log, log)),
    )  # fmt: skip
    sunk = peer(name="glider", heard_ago_s=11_000.0, is_lost=True)
    lost = stream(id=12, name="auv1/log", outcomes={"expired": 1})
    lines = status_text(gateway([lost], [sunk], carry=carry)).splitlines()
    assert max(map(len, lines)) <= WIDTH
    first = lines.index("  carried  auv1/log: 3 for 5 wait")
    assert lines[first + 1 : first + 5] == [
        "           2 of them in custody of 2 glider, heard 3.1 h ago, LOST",
        "           oldest 2.0 h, first expires in 21.9 h",
        f"  carried  {shortened(LONG, 24)}: of others 9 for 1, 340 B",
        "           oldest 2.0 h, first expires in 21.9 h",
    ]
    assert lines[-3:] == [
        "           and 1 more: zacoustic monitor",
        "  custody  for others 340 B of 500 B; 4 expired here",
        "  fails    auv1/log: 1 expired",
    ]
    shown = json.loads(msgspec.json.encode(status_of(gateway([], [sunk], carry=carry))))
    assert shown["carry"]["streams"][0]["custodians"] == {"2": 2}
    assert (shown["nodes"][0]["heard_ago_s"], shown["nodes"][0]["trouble"]) == (11_000.0, "LOST")


@pytest.mark.parametrize(
    "more", [{"state": "down"}, {"is_alive": False}, {"is_silent": True}, {"journal": "full"}]
)
def test_a_gateway_that_cannot_transmit_is_not_well(more: dict[str, object]) -> None:
    assert goes_well(gateway([stream(refused=3)], [peer(is_lost=True)]))
    assert not goes_well(gateway([], [], **more))


def test_tables_fit_a_terminal_whatever_the_names_are() -> None:
    many = {
        "name": LONG, "sent": 123456, "heard": 123456, "sent_ago_s": 119.0, "heard_ago_s": 119.0,
        "sent_rate_hz": 0.016, "heard_rate_hz": 0.016, "age_s": 119.0, "waiting": 99,
        "airtime_share": 1.0,
    }  # fmt: skip
    view = gateway(
        [stream(id=175, **many)],
        [peer(address=254, name=LONG, link=LONG, heard_ago_s=119.0, per=1.0, snr_db=-110.5)],
    )
    for text in (streams_text(view, "topic"), nodes_text(view)):
        assert max(map(len, text.splitlines())) <= WIDTH
    assert "…" in streams_text(view, "topic")


def test_a_rate_is_that_of_the_last_arrivals() -> None:
    meter = RateMeter(3)
    assert meter.rate() is None
    for instant_s in (0.0, 100.0, 102.0, 106.0):
        meter.note(instant_s)
    rate = meter.rate()
    assert rate is not None
    assert (rate.samples, meter.total) == (3, 4)
    assert (rate.min_s, rate.max_s, rate.deviation_s) == (2.0, 4.0, 1.0)
    assert rate.rate_hz == pytest.approx(1 / 3)
    assert json.loads(msgspec.json.encode(rate))["samples"] == 3


def test_long_names_are_cut_so_that_they_stay_apart() -> None:
    names = ["auv1/sensors/ctd/conductivity", "auv2/sensors/ctd/conductivity", "nav", "nav"]
    found = shortened_apart(names, 24)
    assert found[2:] == ["nav", "nav"]
    assert len(set(found)) == 3
    assert all(len(each) <= 24 for each in found)
    assert found[0].startswith("auv1…")
    hopeless = [f"{'x' * 30}{each}{'y' * 30}" for each in "ab"]
    assert shortened_apart(hopeless, 24) == hopeless
    assert shortened_apart(["short", "x" * 30], 24) == ["short", f"…{'x' * 23}"]


def test_a_status_does_not_say_up_of_a_modem_that_is_gone() -> None:
    text = status_text(gateway([], [peer(is_shared=True)], state="down", is_shared=True))
    assert "link     sim/127.0.0.1:7000: down; the gateway runs for 60 s" in text
    assert "ANOTHER NODE has address 1 too" in text
    assert "TWO NODES with this address" in text
    assert not goes_well(gateway([], [], is_shared=True))
