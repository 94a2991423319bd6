"""`zacoustic topic pub --file --wait`: how far a large sample is, and how it ended."""

import io
import json
import random
import sys
from pathlib import Path

import pytest

from tests.cli.watched import lines_of, pair
from tests.gateway.networkpair import verb
from tests.gateway.networks import LIMIT_S, hear, run
from tests.node.fleet import SECTION, ChannelServer
from zacoustic import Node
from zacoustic.app.cli import main
from zacoustic.app.cli.support.progress import ProgressLine
from zacoustic.app.tools.field.following import Step

S2C = "evologics_s2c_18_34"
PHOTO = random.Random("photo").randbytes(3000)
STREAM = {"id": 140, "topic": "photo", "publishers": [1], "subscribers": [2],
          "reliability": "reliable", "max_bytes": 3000}  # fmt: skip


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "photo.jpg"
    path.write_bytes(PHOTO)
    return path


def check_steps(lines: list[dict[str, object]]) -> None:
    """Check the lines of a large sample that was delivered."""
    first, *steps, end = lines
    assert first["bytes"] == len(PHOTO)
    assert (end["event"], end["outcome"]) == ("ended", "delivered")
    sent = [step["sent_bytes"] for step in steps]
    assert sent
    assert sent == sorted(sent, key=lambda sent_bytes: int(str(sent_bytes)))
    assert {step["total_bytes"] for step in steps} == {len(PHOTO)}


def test_gateway_tells_how_far_a_file_is_and_that_it_has_arrived(
    photo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def scene() -> None:
        async with pair(profile=S2C, time_scale=20.0) as found:
            heard = await hear(found.shore, "auv1/photo")
            where = ["--connect", f"tcp/127.0.0.1:{found.auv_network.port}", "--wait"]
            words = ["pub", "auv1/photo", "--file", str(photo), "--json", *where]
            assert await verb(*words, "--timeout", str(LIMIT_S)) == 0
            assert await heard.payload() == PHOTO
            check_steps(lines_of(capsys))
            # One that fits a frame has no steps.
            assert await verb("topic", "pub", "auv1/photo", "small", *where) == 0
            assert capsys.readouterr().out == "auv1/photo: small\nauv1/photo: delivered\n"
            assert await verb("topic", "pub", "chat", "x", *where) == 1
            assert "chat is not reliable" in capsys.readouterr().err
            assert await verb("topic", "pub", "auv1/text", "x", *where) == 1
            assert "no gateway on this network forwards auv1/text" in capsys.readouterr().err

    run(scene())


def test_delivery_tells_it_on_a_link(
    photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fleet.json5"
    section = SECTION | {"streams": [*SECTION["streams"], STREAM]}
    file.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")

    async def scene(locator: str) -> None:
        where = ["--link", locator, "--config", str(file), "--wait"]
        words = ["pub", "photo", "--file", str(photo), *where]
        async with Node("auv1", config=str(file), link=locator) as auv:
            photos = auv.subscribe(bytes, "photo")
            assert await verb(*words, "--json", "--timeout", str(LIMIT_S)) == 0
            assert (await photos.receive()).value == PHOTO
            check_steps(lines_of(capsys))
            assert await verb("topic", "pub", "note", "x", *where) == 1
            assert "it is not reliable" in capsys.readouterr().err
        assert await verb(*words, "--timeout", "0.3") == 3  # nobody is there any more
        assert "not arrived within 0.3 s" in capsys.readouterr().err

    with ChannelServer(S2C) as locator:
        run(scene(locator))


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["note"], "VALUE or --file FILE; allowed: one of the two"),
        (["note", "x", "--file", "PHOTO"], "allowed: one of the two"),
        (["auv1/nav", "--file", "PHOTO", "--address", "2"], "auv1/nav has the type Nav"),
        (["note", "--file", "absent.jpg"], "--file absent.jpg: No such file"),
    ],
)
def test_wrong_arguments_are_exit_code_2(
    words: list[str], text: str, photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fleet.json5"
    file.write_text(json.dumps({"plugins": {"acoustic": SECTION}}), encoding="utf-8")
    written = [str(photo) if word == "PHOTO" else word for word in words]
    with ChannelServer() as locator:
        assert main(["topic", "pub", *written, "--link", locator, "--config", str(file)]) == 2
    assert text in capsys.readouterr().err


def step(sent_bytes: int, done_bytes: int) -> Step:
    return Step(sent_bytes=sent_bytes, done_bytes=done_bytes, total_bytes=1000)


def test_without_a_terminal_there_is_a_line_for_each_tenth(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with ProgressLine("photo", as_json=False) as line:
        for sent_bytes in range(0, 1001, 25):
            line.show(step(sent_bytes, 0))
        line.show(step(1000, 500))
        line.show(step(1000, 1000))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        *(f"photo: {percent} % sent, 0 % there" for percent in range(0, 101, 10)),
        "photo: 100 % sent, 100 % there",
    ]


def test_on_a_terminal_there_are_bars(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rich")

    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with ProgressLine("photo", as_json=False) as line:
        line.show(step(250, 0))
        line.show(step(1000, 700))
    drawn = screen.getvalue()
    for word in ("sent", "there", "0.7/1.0 kB"):
        assert word in drawn
