"""`decode` opens sealed frames with the key, and says of others that they are sealed."""

import io
import json
from functools import partial
from pathlib import Path
from typing import Any, Final

import pytest

from tests.recording.memory import recorded
from tests.virtual.fleet import line
from tests.virtual.sealed import KEY, SealedFleet
from zacoustic.app.cli import main
from zacoustic.app.tools.inspect.decode.opening import FrameOpener
from zacoustic.app.tools.inspect.recordings.replaying.frames import DecodedFrame, FrameReader
from zacoustic.config import config_from_mapping
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.run.recording.reading import ReadMessage
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import new_key, write_key
from zacoustic.testing.virtual import Modem, VirtualNetwork

SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv"}],
    "streams": [
        {"id": 10, "topic": "{node}/nav"},
        {"id": 11, "service": "arm", "server": 2},
    ],
}
TABLE: Final = config_from_mapping(SECTION, source="made up").table


def run_sealed(**settings: Any) -> None:
    """Let node 1 publish, and call twice."""
    network = VirtualNetwork(line(0, 800), TABLE, **settings)
    for number in range(30):
        network.at(5.0 + 10.0 * number, partial(network.publish, 1, 10, b"here %d" % number))
    for at_s in (52.0, 152.0):
        network.at(at_s, partial(network.apply, 1, _arm))
    network.run(until_s=600.0)


def _arm(engine: Engine, now: int) -> None:
    engine.call(11, b"arm", now)


def read(messages: list[ReadMessage], opener: FrameOpener | None) -> list[DecodedFrame]:
    reader = FrameReader(opener=opener)
    return [frame for message in messages for frame in reader.read(message)]


@pytest.mark.parametrize("modem", [Modem(), Modem(addressed=False, checked=False)])
def test_frames_of_a_recording_are_opened_with_the_key(modem: Modem) -> None:
    recorder, sink = recorded()
    run_sealed(build=SealedFleet(make=recorder.make), modem=modem)
    recorder.finish()
    opener = FrameOpener(FleetCipher(KEY), nodes=(1, 2), digest=TABLE.digest)
    frames = read(sink.messages, opener)
    samples = [
        item.value for frame in frames for item in frame.items
        if item.name == "shore/nav" and frame.direction == "sent"
    ]  # fmt: skip
    assert samples == [(b"here %d" % number).hex() for number in range(30)]
    assert not [item for frame in frames for item in frame.items if item.fault]
    seals = [frame.items[0].value for frame in frames]
    assert {each["strong"] for each in seals if isinstance(each, dict)} == {True, False}
    for frame in read(sink.messages, None):
        (item,) = frame.items
        assert (item.kind, "needs the key" in item.fault) == ("sealed", True)


def test_frames_in_hexadecimal_are_opened_with_the_key_of_the_configuration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    traced: list[TraceRecord] = []
    run_sealed(build=SealedFleet(), trace=traced.append)
    sent = [each for each in traced if each.what == "transmit" and each.node == 1]
    write_key(tmp_path / "fleet.key", KEY)
    write_key(tmp_path / "other.key", new_key("tests"))
    paths = {}
    for name in ("fleet", "other"):
        paths[name] = tmp_path / f"{name}.json5"
        section = {**SECTION, "security": {"key": f"{name}.key"}}
        paths[name].write_text(json.dumps({"plugins": {"acoustic": section}}))

    def decode(name: str, *frames: str) -> list[list[dict[str, Any]]]:
        assert main(["decode", "--json", "--config", str(paths[name]), *frames]) == 0
        return [json.loads(line)["items"] for line in capsys.readouterr().out.splitlines()]

    items = decode("fleet", *(each.frame for each in sent))
    seals = [each[0]["value"] for each in items]
    assert [(each["source"], each["destination"]) for each in seals] == [
        (1, each.peer) for each in sent
    ]
    assert {each["life"] for each in seals} == {seals[0]["life"]}
    counters = [each["counter"] for each in seals if each["destination"] == 255]
    assert counters == list(range(len(counters)))
    # From a trace, where nothing has to be tried out; a short head alone cannot be opened.
    text = "\n".join(json.dumps(
        {"what": "transmit", "node": 1, "peer": each.peer, "frame": each.frame}
    ) for each in sent)  # fmt: skip
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    assert [each[0]["value"] for each in decode("fleet")] == seals
    short = next(each.frame for each in sent if int(each.frame[:2], 16) < 0x80)
    ((alone,),) = decode("fleet", short)
    assert "a short head before any long one" in alone["fault"]
    for ((item, *more),) in [decode("other", each.frame) for each in sent[:3]]:
        assert more == []
        assert "does not open: another key or table" in item["fault"]
    ((item, *_),) = decode("other", "--unsealed", sent[0].frame)
    assert item["kind"] != "sealed"
