"""A Zenoh network into a file, and back."""

import asyncio
import base64
import json
from pathlib import Path
from typing import Any

import cbor2
import pytest
import zenoh

from tests.gateway.networks import (
    SECTION,
    Channel,
    Heard,
    LocalNetwork,
    cbor,
    fence,
    hear,
    local_network,
    matched,
    run,
    until,
    zenoh_config,
    zenoh_router,
)
from tests.recording.test_foxglove import JPEG
from zacoustic.app.tools.inspect.recordings.replaying.frames import decode_recording
from zacoustic.app.tools.inspect.recordings.replaying.playing import Played, play
from zacoustic.app.tools.inspect.recordings.zenohrecord import RecordedKeys, record_network
from zacoustic.config import Config, config_from_mapping
from zacoustic.errors import ConfigError
from zacoustic.ros.attachment import Attachment
from zacoustic.ros.streams import RosTopic
from zacoustic.run.recording.reading import ReadMessage, RecordingReader
from zacoustic.zenoh.session.marker import read_marker

CONFIG = config_from_mapping(SECTION, source="test")


class Recording:
    """A recording of a network that runs meanwhile."""

    def __init__(self, path: Path, port: int, *keys: str, config: Config | None = CONFIG) -> None:
        self.stop = asyncio.Event()
        self.heard: list[str] = []
        self.changed = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._ready = asyncio.Event()
        self._task = asyncio.create_task(
            record_network(
                path,
                config=config,
                connect=[f"tcp/127.0.0.1:{port}"],
                keys=keys,
                stop=self.stop,
                ready=lambda path, keys: self._ready.set(),
                heard=self._hear,
            )
        )

    async def ready(self) -> None:
        waits = asyncio.create_task(self._ready.wait())
        await asyncio.wait({self._task, waits}, return_when=asyncio.FIRST_COMPLETED)
        waits.cancel()
        if self._task.done():
            self._task.result()

    def _hear(self, key: str) -> None:
        self._loop.call_soon_threadsafe(self._note, key)

    def _note(self, key: str) -> None:
        self.heard.append(key)
        self.changed.set()

    async def until(self, *keys: str) -> None:
        """Wait until all these keys are in the recording."""
        await until(lambda: set(keys) <= set(self.heard), self.changed)

    async def end(self) -> RecordedKeys:
        self.stop.set()
        return await self._task


def read(path: Path) -> dict[str, list[ReadMessage]]:
    found: dict[str, list[ReadMessage]] = {}
    for message in RecordingReader(path):
        found.setdefault(message.topic, []).append(message)
    return found


async def played(path: Path, port: int, **settings: Any) -> Played:
    options: dict[str, Any] = {"config": None, "rate": None, "keys": (), "node": None}
    return await play(
        path,
        connect=[f"tcp/127.0.0.1:{port}"],
        stop=asyncio.Event(),
        **{**options, **settings},
    )


def test_topics_documents_and_frames_of_a_running_gateway(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"

    async def main() -> RecordedKeys:
        channel = Channel()
        async with local_network(1, channel) as shore, local_network(2, channel) as auv:
            recording = Recording(path, shore.port, "free/**")
            await recording.ready()
            with shore.client() as here, auv.client() as there:
                # The gateway hears of a subscriber some time after that: so again and again.
                while "@acoustic/1/frames" not in recording.heard:
                    await one_frame(channel, here, "chat", b"are you listening?")
                heard = await hear(here, "auv1/nav")
                there.put("auv1/nav", cbor(depth=7.0, mode="idle"))
                await heard.next()
                here.put("auv1/text", b"\xff\x00")
                here.put("auv1/text", JPEG)
                here.put("free/key", '{"lat": 1, "lon": 2}', encoding="application/json")
                measured = '{"propagation_s": 0.5, "range_m": null}'
                here.put("@acoustic/1/peer/2/range", measured, encoding="application/json")
                await recording.until(
                    "auv1/nav", "auv1/text", "free/key", "@acoustic/1/peer/2/range",
                    "@acoustic/1/frames", "@acoustic/1/reports", "@acoustic/1/ledger",
                )  # fmt: skip
            return await recording.end()

    found = run(main())
    messages = read(path)
    assert (found.messages["auv1/nav"], found.messages["auv1/text"]) == (1, 2)
    (nav,) = messages["/auv1/nav"]
    assert json.loads(nav.data) == {"depth": 7.0, "mode": "idle"}
    (free,) = messages["/free/key"]
    assert json.loads(free.data) == {"lat": 1, "lon": 2}
    (place,) = messages["/foxglove/free/key/location"]
    assert json.loads(place.data)["longitude"] == 2
    (image,) = messages["/foxglove/auv1/text/image"]
    assert json.loads(image.data)["format"] == "jpeg"
    assert "/foxglove/1/range_to_2" not in messages  # nobody knows where the nodes are
    samples = {each["key"]: each for each in map(data_of, messages["/samples"])}
    assert samples["auv1/nav"]["source"] == 2
    assert "source" not in samples["auv1/text"]
    assert "/@acoustic/1/ledger" in messages
    frames = [data_of(each) for each in messages["/@acoustic/1/frames"]]
    assert {frame["direction"] for frame in frames} == {"sent", "received"}
    assert messages["/@acoustic/1/reports"]
    words = [item.text for frame in decode_recording(path) for item in frame.items]
    assert any("HELLO" in each for each in words)
    assert any('auv1/nav, 0 s old: {"depth": 7.0, "mode": "idle"}' in each for each in words)


async def one_frame(channel: Channel, session: zenoh.Session, key: str, payload: bytes) -> None:
    """Have node 1 send a frame."""
    before = channel.sent_by(1)
    session.put(key, payload)
    await until(lambda: channel.sent_by(1) > before, channel.changed)
    await fence(session)


async def until_sent(channel: Channel, address: int) -> None:
    while not channel.sent_by(address):
        channel.changed.clear()
        await channel.changed.wait()


def data_of(message: ReadMessage) -> Any:
    return json.loads(message.data)


def test_a_router_that_is_gone_for_a_while_is_said_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> RecordedKeys:
        with zenoh_router() as port:
            recording = Recording(tmp_path / "a.mcap", port, "free/**")
            await recording.ready()
        with zenoh_router(port), zenoh.open(zenoh_config("client", connect=port)) as other:
            await matched(other, "free/word")  # the recorder comes back by itself
            other.put("free/word", b"hello")
            await recording.until("free/word")
            return await recording.end()

    found = run(main())
    assert found.gaps == 1
    assert [record.message for record in caplog.records] == [
        "the Zenoh router is gone; nothing comes or goes until it is back",
        "the Zenoh router is back",
    ]


def test_frames_are_put_only_while_somebody_subscribes() -> None:
    async def main() -> None:
        channel = Channel()
        async with local_network(1, channel) as shore:
            with shore.client() as here:
                here.put("auv1/text", b"before")
                await until_sent(channel, 1)
                heard = await hear(here, "@acoustic/1/frames")
                # The gateway hears of a subscriber some time after that: so again and again.
                while not heard.samples:
                    await one_frame(channel, here, "auv1/text", b"while")
                first = json.loads(await heard.payload())
                assert first["direction"] == "sent"
                # Either the new sample, or the first one again: nobody has acknowledged it.
                assert base64.b64decode(first["frame"]).endswith((b"while", b"before"))

    run(main())


def test_a_recorded_network_is_put_again_byte_for_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    sent = [
        ("auv1/nav", cbor(depth=1.0, mode="idle"), "application/cbor"),
        ("auv1/nav", b"\x00 no CBOR at all", "application/cbor"),
        ("chat", b"\x00\xff", "text/plain"),
        ("auv1/json", b'{ "depth":2,"mode": "abort" }', "application/json"),
    ]

    async def record() -> None:
        with zenoh_router() as port:
            recording = Recording(path, port)
            await recording.ready()
            with LocalNetwork(port).client() as here:
                for key, payload, encoding in sent:
                    await matched(here, key)
                    here.put(key, payload, encoding=encoding, attachment=b"beside")
                here.delete("chat")
                await until(lambda: len(recording.heard) > len(sent), recording.changed)
            await recording.end()

    async def again() -> tuple[list[Any], Played]:
        with zenoh_router() as port, LocalNetwork(port).client() as here:
            heard = await hear(here, "**")
            result = await played(path, port)
            return [await heard.next() for _ in range(len(sent) + 1)], result

    run(record())
    samples, result = run(again())
    # Zenoh keeps the order of each key, and of a subscriber, not that of several.
    by_key: dict[str, list[tuple[bytes, str]]] = {}
    for each in samples:
        if str(each.kind) == "SampleKind.PUT":
            assert each.attachment.to_bytes() == b"beside"
            said = (each.payload.to_bytes(), str(each.encoding))
            by_key.setdefault(str(each.key_expr), []).append(said)
    expected: dict[str, list[tuple[bytes, str]]] = {}
    for key, payload, encoding in sent:
        expected.setdefault(key, []).append((payload, encoding))
    assert by_key == expected
    chats = [str(each.kind) for each in samples if str(each.key_expr) == "chat"]
    assert chats == ["SampleKind.PUT", "SampleKind.DELETE"]
    assert result.samples == {"auv1/nav": 2, "chat": 2, "auv1/json": 1}


def test_topics_of_ros_are_recorded_and_put_under_their_own_keys(tmp_path: Path) -> None:
    stream = {"id": 1, "topic": "/cmd_vel", "type": "geometry_msgs/msg/Twist", "ros": {}}
    config = config_from_mapping({"address": 1, "ros": {}, "streams": [stream]}, source="test")
    assert config.ros is not None
    topic = config.ros.streams[1]
    assert isinstance(topic, RosTopic)
    key = str(topic.key(config.ros.domain, "cmd_vel"))
    value = {part: {"x": 1.0, "y": 0.0, "z": 0.0} for part in ("linear", "angular")}
    cdr = topic.message.write(value)
    beside = Attachment(sequence=1, stamp_ns=5, gid=bytes(16)).encode()
    path = tmp_path / "a.mcap"

    async def record() -> None:
        with zenoh_router() as port:
            recording = Recording(path, port, config=config)
            await recording.ready()
            with LocalNetwork(port).client() as here:
                await matched(here, key)
                here.put(key, cdr, attachment=beside)
                await recording.until(key)
            await recording.end()

    async def again() -> Any:
        with zenoh_router() as port, LocalNetwork(port).client() as here:
            heard = await hear(here, key)
            await played(path, port)
            return await heard.next()

    run(record())
    (message,) = read(path)[f"/{key}"]
    assert (message.encoding, message.data) == ("cdr", cdr)
    sample = run(again())
    assert sample.payload.to_bytes() == cdr
    assert sample.attachment.to_bytes() == beside


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    from tests.recording.smalltrial import CHANNEL, FLEET
    from zacoustic.app.cli import main

    (tmp_path / "water.json5").write_text(CHANNEL, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(FLEET, encoding="utf-8")
    path = tmp_path / "trial.mcap"
    assert (
        main(["sim", str(tmp_path / "water.json5"), "--until", "120", "--record", str(path)]) == 0
    )
    return path


def test_a_recorded_engine_is_put_with_the_mark_of_what_came_off_the_channel(trial: Path) -> None:
    async def main() -> tuple[list[Any], Played, Played]:
        with zenoh_router() as port, LocalNetwork(port).client() as here:
            heard: Heard = await hear(here, "auv1/**")
            result = await played(trial, port, node=1, keys=["auv1/nav"])
            samples = [await heard.next() for _ in range(result.samples["auv1/nav"])]
            raw = await played(trial, port, node=2, keys=["auv1/raw"])
            samples += [await heard.next() for _ in range(raw.samples["auv1/raw"])]
            return samples, result, raw

    samples, result, raw = run(main())
    navs = samples[: result.samples["auv1/nav"]]
    assert len(navs) >= 4
    for each in navs:
        assert cbor2.loads(each.payload.to_bytes()) == {
            "depth": pytest.approx(4.2),
            "mode": "survey",
        }
        mark = read_marker(each.attachment)
        assert mark is not None
        assert mark.acoustic == 2
        assert mark.age_s is not None
    for each in samples[len(navs) :]:
        assert each.attachment is None
        assert len(each.payload.to_bytes()) == 10
    assert raw.samples == {"auv1/raw": 5}


def test_of_several_nodes_one_has_to_be_said(trial: Path) -> None:
    async def main() -> None:
        with zenoh_router() as port:
            with pytest.raises(ConfigError, match=r"several nodes, 1 and 2 among them .*--node"):
                await played(trial, port)
            with pytest.raises(ConfigError, match="key expression"):
                await played(trial, port, node=1, keys=["a//b"])
            with pytest.raises(ConfigError, match=r"no sample of nothing/here is in it"):
                await played(trial, port, node=1, keys=["nothing/here"])

    run(main())


def test_instants_are_kept_and_the_rate_divides_them(trial: Path) -> None:
    waited: list[float] = []

    async def main() -> Played:
        loop = asyncio.get_running_loop()
        began_s = loop.time()

        def now_s() -> float:
            waited.append(loop.time() - began_s)
            return loop.time()

        with zenoh_router() as port:
            return await played(trial, port, node=1, rate=200.0, keys=["auv1/nav"], now_s=now_s)

    result = run(main())
    assert result.duration_s > 60
    assert waited[-1] >= (result.duration_s - 20) / 200
