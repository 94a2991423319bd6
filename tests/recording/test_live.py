"""A gateway and a node in direct mode, recorded while they run."""

import asyncio
import logging
import random
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest

from tests.gateway.networks import (
    Channel,
    LocalNetwork,
    cbor,
    config_of,
    free_port,
    get,
    hear,
    zenoh_config,
)
from tests.gateway.networks import run as run_networks
from tests.node.fleet import channel
from tests.runtime.loop_checks import run
from zacoustic import ConfigError, Node
from zacoustic.app.tools.inspect.recordings.replaying.checking import check_recording
from zacoustic.gateway import Gateway
from zacoustic.run.recording.channels import events_channel
from zacoustic.run.recording.reading import RecordingReader
from zacoustic.run.recording.writing import RecordingFile


def values(path: Path, ending: str) -> list[Any]:
    """Return the JSON messages of the topics that end so."""
    reader = RecordingReader(path)
    found = [msgspec.json.decode(each.data) for each in reader if each.topic.endswith(ending)]
    assert not reader.damage
    return found


def test_recorded_gateways_are_replayed_exactly(tmp_path: Path) -> None:
    async def main() -> None:
        sea = Channel()
        found = {}
        async with asyncio.TaskGroup() as group:
            done = asyncio.Event()

            async def live(address: int, ready: asyncio.Event) -> None:
                here = found[address] = LocalNetwork(free_port())
                settings = config_of(address, zenoh_config("router", listen=here.port))
                async with Gateway(
                    settings,
                    link=sea.medium.link(address),
                    record=tmp_path / f"{address}.mcap",
                    notify=here.notify,
                ):
                    ready.set()
                    await done.wait()

            readies = [asyncio.Event(), asyncio.Event()]
            for address, ready in zip((1, 2), readies, strict=True):
                group.create_task(live(address, ready))
            for ready in readies:
                await ready.wait()
            with found[1].client() as shore, found[2].client() as auv:
                heard = await hear(shore, "auv1/**")
                auv.put("auv1/nav", cbor(depth=12.34, mode="survey"))
                assert "auv1/nav" in str((await heard.next()).key_expr)
                replies = await get(shore, "auv1/hasty", b"quick")
                assert replies.errors
            done.set()

    run_networks(main())
    for address in (1, 2):
        verdict = check_recording(tmp_path / f"{address}.mcap")
        assert verdict.is_same, verdict.epochs
        assert not verdict.damage
        assert verdict.epochs[0].frames
    assert values(tmp_path / "1.mcap", "/1/received/auv1/nav") == [
        {"depth": pytest.approx(12.3), "mode": "survey"}
    ]
    assert values(tmp_path / "2.mcap", "/2/published/auv1/nav") == [
        {"depth": pytest.approx(12.34), "mode": "survey"}
    ]
    kinds = {event["event"] for event in values(tmp_path / "1.mcap", "/events")}
    assert {"LinkStateChanged", "SampleReceived", "CallFailed", "PeerSeen"} <= kinds


def test_a_node_in_direct_mode_is_recorded_with_what_it_declares(tmp_path: Path) -> None:
    path = tmp_path / "node.mcap"

    class Wave(msgspec.Struct):
        height: float

    async def main() -> None:
        with channel() as medium:
            async with (
                Node(1, link=medium.link(1), record=path) as shore,
                Node(2, link=medium.link(2)) as auv,
            ):
                arrived = asyncio.Event()
                shore.create_subscription(bytes, "note", lambda sample: arrived.set(), stream_id=2)
                auv.create_subscription(Wave, "waves", lambda sample: None, stream_id=1)
                shore.create_publisher(Wave, "waves", stream_id=1).publish(Wave(0.5))
                auv.create_publisher(bytes, "note", stream_id=2).publish(b"hello")
                await arrived.wait()

    run(main())
    assert check_recording(path).is_same
    assert values(path, "/1/published/waves") == [{"height": 0.5}]
    assert values(path, "/1/received/note")[0]["data"] == "aGVsbG8="


def test_a_recording_that_is_there_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"mine")
    file = RecordingFile(tmp_path / "a.mcap")
    file.close()
    assert (tmp_path / "a.mcap").read_bytes() == b"mine"
    assert file.path != tmp_path / "a.mcap"
    assert not list(RecordingReader(file.path))


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"recording .*a\.mcap: "):
        RecordingFile(tmp_path / "file" / "a.mcap")
    with pytest.raises(ConfigError, match="record is given without link"):
        run(_opened(Node("a", record=tmp_path / "b.mcap")))


async def _opened(node: Node) -> None:
    async with node:
        pass


class _Usage(NamedTuple):
    total: int
    used: int
    free: int


def test_a_full_disk_ends_the_recording_and_not_the_gateway(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: _Usage(1 << 30, 1 << 30, 1 << 20))
    monkeypatch.setattr("zacoustic.run.recording.writing.FLUSH_S", 0.01)

    async def main() -> None:
        sea = Channel()
        here = LocalNetwork(free_port())
        settings = config_of(1, zenoh_config("router", listen=here.port))
        async with Gateway(
            settings, link=sea.medium.link(1), record=tmp_path / "a.mcap", notify=here.notify
        ):
            while not here.told("recording"):
                here.changed.clear()
                await here.changed.wait()
            with here.client() as shore:
                shore.put("auv1/text", b"it goes on")
                while not sea.sent_by(1):
                    sea.changed.clear()
                    await sea.changed.wait()
        (told,) = here.told("recording")
        assert "almost full, 1 MiB" in told.lines()[0]
        (started,) = here.told("started")
        assert started.facts["recording"] == str(tmp_path / "a.mcap")

    run_networks(main())


def test_what_finds_the_queue_full_is_dropped_counted_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zacoustic.run.recording.writing.QUEUE_BYTES", 1000)
    file = RecordingFile(tmp_path / "a.mcap")
    channel = events_channel(1)
    with file._changed, caplog.at_level(logging.WARNING):  # the writer cannot take anything
        taken = [file.put(channel, number, b"x" * 300) for number in range(10)]
    file.close()
    assert taken == [True] * 3 + [False] * 7
    assert file.dropped == 7
    assert [record.message for record in caplog.records] == [
        f"{file.path}: the disk is too slow, something is not recorded"
    ]
    assert len(list(RecordingReader(file.path))) == 3


def test_a_file_that_nobody_has_finished_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap", waits=True)
    rng = random.Random(1)
    for number in range(30):
        file.put(events_channel(1), number, rng.randbytes(100_000))
    file.close()
    whole = file.path.read_bytes()
    assert len(list(RecordingReader(file.path))) == 30
    cut = tmp_path / "cut.mcap"
    lengths = set()
    for size in range(8, len(whole) - 1, len(whole) // 40):
        cut.write_bytes(whole[:size])
        reader = RecordingReader(cut)
        read = list(reader)
        assert [each.utc_ns for each in read] == list(range(len(read)))
        assert reader.damage
        lengths.add(len(read))
    assert len(lengths) > 2
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0x10
    cut.write_bytes(flipped)
    reader = RecordingReader(cut)
    list(reader)
    assert reader.damage


_WRITER = """
import sys
from zacoustic.run.recording import writing
from zacoustic.run.recording.channels import events_channel
writing.FLUSH_S = 0.02
file = writing.RecordingFile(sys.argv[1], waits=True)
number = 0
while True:
    file.put(events_channel(1), number, b'{"event": "Test"}')
    number += 1
    if number == 20_000:
        print("ready", flush=True)
"""


def test_what_a_killed_process_has_recorded_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    command = [sys.executable, "-c", _WRITER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.kill()
    reader = RecordingReader(path)
    read = [each.utc_ns for each in reader]
    assert read == list(range(len(read)))
    assert len(read) > 1000
    assert reader.damage
