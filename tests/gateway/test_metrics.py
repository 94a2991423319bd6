"""What a gateway answers to Prometheus, and what its log says as JSON."""

import asyncio
import json
import logging
import sys
import urllib.error
import urllib.request
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("prometheus_client")

from prometheus_client.parser import text_string_to_metric_families

from tests.cli.watched import WATCHED
from tests.gateway.networks import (
    SECTION,
    Channel,
    LocalNetwork,
    cbor,
    config_of,
    free_port,
    hear,
    local_network,
    matched,
    run,
    zenoh_config,
)
from tests.gateway.test_command import ended, open_medium, running, start, write_file
from zacoustic.app.tools.field.jsonlog import FIELDS, JsonFormatter
from zacoustic.config import config_from_mapping
from zacoustic.config.metrics import metrics_argument, parse_metrics
from zacoustic.core.bond.reach import Reach
from zacoustic.core.relay.relay import Hop
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.gateway import Gateway
from zacoustic.status.link import BondDocument, LinkDocument
from zacoustic.zenoh.gateway.status import metrics as status_metrics
from zacoustic.zenoh.gateway.status.metrics import _hops, _reachable
from zacoustic_sim.link import SimConfig

Labels = tuple[tuple[str, str], ...]
LINK: Labels = (("link", "link"),)


@asynccontextmanager
async def measured(
    channel: Channel, address: int, place: tuple[str, int] | None = ("127.0.0.1", 0)
) -> AsyncIterator[tuple[LocalNetwork, str]]:
    """Run a gateway with metrics; gives where they are."""
    found = LocalNetwork(free_port())
    section = WATCHED | {"metrics_names": ["auv1.example"]}
    config = config_of(address, zenoh_config("router", listen=found.port), section)
    link = channel.medium.link(address, SimConfig(acknowledges=True))
    async with Gateway(config, link=link, notify=found.notify, metrics=place):
        started = found.told("started")[0]
        yield found, started.facts["metrics"]


async def scrape(url: str) -> dict[tuple[str, Labels], float]:
    """Return all values, by name and labels, as Prometheus reads them."""

    def read() -> str:
        with urllib.request.urlopen(url, timeout=20) as answer:
            return str(answer.read().decode())

    families = text_string_to_metric_families(await asyncio.to_thread(read))
    return {
        (each.name, tuple(sorted(each.labels.items()))): each.value
        for family in families
        for each in family.samples
    }


def test_metrics_are_those_of_the_health_report() -> None:
    async def scene() -> None:
        channel = Channel()
        async with (
            measured(channel, 1) as (shore, url),
            local_network(2, channel, section=WATCHED) as auv,
        ):
            assert url.startswith("http://127.0.0.1:")
            with shore.client() as client, auv.client() as vehicle:
                await matched(vehicle, "auv1/nav")
                heard = await hear(client, "auv1/nav")
                payload = cbor(depth=12.5, mode="survey")
                vehicle.put("auv1/nav", payload, encoding="application/cbor")
                await heard.next()
                found = await scrape(url)
                nav: Labels = (("stream", "auv1/nav"),)
                assert found["zacoustic_stream_received_records_total", nav] == 1
                assert found["zacoustic_stream_transmitted_records_total", nav] == 0
                assert found["zacoustic_stream_last_received_timestamp_seconds", nav] > 1.6e9
                assert ("zacoustic_stream_last_transmitted_timestamp_seconds", nav) not in found
                assert found["zacoustic_frames_received_total", LINK] >= 1
                assert found["zacoustic_link_up", LINK] == 1
                assert found["zacoustic_silent", ()] == 0
                assert found["zacoustic_journal_kept", ()] == 0
                peer: Labels = (("peer", "2"),)
                assert found["zacoustic_peer_range_meters", peer] == 1.0
                assert found["zacoustic_peer_same_table", peer] == 1
                assert found["zacoustic_objects", (("direction", "sending"),)] == 0
                about = next(
                    dict(labels) for name, labels in found if name == "zacoustic_gateway_info"
                )
                assert (about["address"], about["name"], about["wire"]) == ("1", "shore", "native")
                photo: Labels = (("outcome", "delivered"), ("stream", "auv1/photo"))
                vehicle.put("auv1/photo", b"x")
                while (
                    not (await scrape(url))["zacoustic_frames_received_total", LINK]
                    > found["zacoustic_frames_received_total", LINK]
                ):
                    pass
                assert (await scrape(url))["zacoustic_stream_deliveries_total", photo] == 0

    run(scene())


def status_for(url: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        with error:
            return error.code


def test_other_pages_cannot_read_them_through_a_browser() -> None:
    async def scene() -> None:
        async with measured(Channel(), 1) as (_, url):
            for host, status in (
                ("127.0.0.1:9464", 200),
                ("localhost", 200),
                ("AUV1.example:9464", 200),
                ("evil.example:9464", 403),
            ):
                assert await asyncio.to_thread(status_for, url, Host=host) == status
            assert await asyncio.to_thread(status_for, url, Origin="http://evil.example") == 403

    run(scene())


def test_scrapes_in_a_row_ask_the_gateway_once_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        asked: list[int] = []
        now = [0]

        def documents() -> dict[str, object]:
            asked.append(now[0])
            return {}

        monkeypatch.setattr(status_metrics, "metrics_of", lambda _: ())
        loop = asyncio.get_running_loop()
        collector = status_metrics._HealthCollector(documents, loop, lambda: now[0])
        for now[0] in (0, 999_999_999, 1_000_000_000, 1_500_000_000):
            await asyncio.to_thread(collector.collect)
        assert asked == [0, 1_000_000_000]

    run(scene())


@pytest.mark.parametrize("name", ["", "a b", "http://auv1", "auv1:9464", "*.example"])
def test_names_of_the_metrics_are_host_names(name: str) -> None:
    with pytest.raises(ConfigError, match=r"metrics_names\[0\]: .*; allowed: a host name"):
        config_from_mapping(SECTION | {"metrics_names": [name]}, source="test")


def test_lists_of_links_and_hops_have_metrics() -> None:
    nodes = {
        1: {"radio": Reach.DOUBT, "acoustic": Reach.UP},
        3: {"radio": Reach.DOWN, "odd": Reach.DOWN},
    }
    documents: dict[str, Any] = {
        "bond/a": BondDocument(reach=nodes),
        "bond/b": BondDocument(reach={3: {"radio": Reach.UP}}),
        "link": LinkDocument(),
    }
    hop = Hop(route="far", next_node=2, waiting=0, transmissions=14, passed_on=9, given_up=1)
    families = [_reachable(documents), *_hops([hop])]
    found = {
        (each.name, *each.labels.values()): each.value
        for family in families
        for each in family.samples
    }
    assert found == {
        ("zacoustic_peer_link_reachable", "1", "radio"): 0.5,
        ("zacoustic_peer_link_reachable", "1", "acoustic"): 1.0,
        ("zacoustic_peer_link_reachable", "3", "radio"): 1.0,
        ("zacoustic_peer_link_reachable", "3", "odd"): 0.0,
        ("zacoustic_relay_hop_transmissions_total", "far", "2"): 14,
        ("zacoustic_relay_hop_passed_on_total", "far", "2"): 9,
        ("zacoustic_relay_hop_given_up_total", "far", "2"): 1,
    }


def test_no_metrics_unless_asked_for_and_none_when_it_has_ended() -> None:
    async def scene() -> None:
        channel = Channel()
        async with measured(channel, 1, None) as (_, url):
            assert url == ""
        async with measured(channel, 1) as (_, url):
            await scrape(url)
        with pytest.raises(OSError, match="refused"):
            await scrape(url)

    run(scene())


def test_place_that_is_taken_ends_the_gateway_in_one_line() -> None:
    async def scene() -> None:
        channel = Channel()
        async with measured(channel, 1) as (_, url):
            port = int(url.rpartition(":")[2].partition("/")[0])
            with pytest.raises(LinkOpenError, match=f"cannot listen at 127.0.0.1:{port}"):
                async with measured(channel, 2, ("127.0.0.1", port)):
                    pass

    run(scene())


def test_absent_library_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        monkeypatch.setitem(sys.modules, "prometheus_client", None)
        monkeypatch.delitem(sys.modules, "zacoustic.zenoh.gateway.status.metrics", raising=False)
        with pytest.raises(ConfigError, match=r"pip install '\.\[metrics\]'"):
            async with measured(Channel(), 1):
                pass

    run(scene())


@pytest.mark.parametrize(
    ("written", "place"),
    [
        ("9464", ("127.0.0.1", 9464)),
        ("0.0.0.0:9464", ("0.0.0.0", 9464)),
        ("[::1]:0", ("::1", 0)),
        ("localhost:1", ("localhost", 1)),
        ("", None),
        ("host", None),
        (":9464", None),
        ("host:70000", None),
        ("::1:9464", None),
    ],
)
def test_place_of_the_metrics(written: str, place: tuple[str, int] | None) -> None:
    assert parse_metrics(written) == place
    section = SECTION | {"metrics": written}
    if place is not None:
        assert config_from_mapping(section, source="test").metrics == place
        assert metrics_argument(written) == place
    else:
        with pytest.raises(ConfigError, match=r'\.metrics: .*; allowed: a text, "PORT"'):
            config_from_mapping(section, source="test")
        with pytest.raises(ConfigError, match="--metrics"):
            metrics_argument(written)


def record(**extra: object) -> logging.LogRecord:
    made = logging.LogRecord("a.b", logging.WARNING, "x.py", 1, "%s is\nlost", ("auv1",), None)
    made.created = 1_767_225_600.25
    made.__dict__.update(extra)
    return made


def test_log_message_is_one_line_of_json_with_its_fields() -> None:
    line = JsonFormatter({"node": 2}).format(record(**{FIELDS: {"event": "lost", "level": "no"}}))
    assert "\n" not in line
    assert json.loads(line) == {
        "time": "2026-01-01T00:00:00.250Z",
        "level": "warning",
        "logger": "a.b",
        "message": "auv1 is\nlost",
        "node": 2,
        "event": "lost",
    }
    try:
        raise ValueError("gone")
    except ValueError:
        line = JsonFormatter({}).format(record(exc_info=sys.exc_info()))
    assert "ValueError: gone" in json.loads(line)["exception"]


def test_gateway_logs_json_on_standard_error_and_nothing_on_standard_output(
    tmp_path: Path,
) -> None:
    async def scene() -> None:
        from contextlib import AsyncExitStack

        async with AsyncExitStack() as stack:
            link = await open_medium(stack, tmp_path)
            file = write_file(tmp_path / "shore.json5", listen=free_port())
            words = ["--link", link, "--log", "json", "--metrics", "0"]
            process = await stack.enter_async_context(running("run", "gateway", file, *words))
            assert process.stderr is not None
            lines: list[dict[str, Any]] = []
            while not any(line.get("event") == "started" for line in lines):
                lines.append(json.loads(await process.stderr.readline()))
            assert lines[-1]["metrics"].startswith("http://127.0.0.1:")
            process.terminate()
            code, out, err = await ended(process)
            lines += [json.loads(line) for line in err.splitlines()]
            assert (code, out) == (0, "")
            for line in lines:
                assert {"time", "level", "logger", "message"} <= set(line), line
            last = lines[-1]
            assert (last["event"], last["node"], last["level"]) == ("stopped", 1, "info")
            assert last["logger"] == "zacoustic.gateway"
        # What ends it is JSON as well.
        absent = tmp_path / "absent.json5"
        code, out, err = await ended(await start("run", "gateway", absent, "--log", "json"))
        assert (code, out) == (2, "")
        assert "absent.json5" in json.loads(err)["message"]
        assert json.loads(err)["level"] == "error"

    run(scene())
