"""The verbs pub, sub and call, as a user runs them, on a link and on Zenoh."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

from tests.node.fleet import SECTION, Arm, ChannelServer, free_endpoint, router
from zacoustic import blocking

ROOT: Final = Path(__file__).parents[2]
LIMIT_S: Final = 30.0


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.json5"
    path.write_text(json.dumps({"plugins": {"acoustic": SECTION}}))
    return path


def run(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*words), **options(), timeout=LIMIT_S, check=False)


@contextmanager
def started(*words: object) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(command(*words), **options())
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "zacoustic", *(str(word) for word in words)]


def options() -> dict[str, Any]:
    pipe = subprocess.PIPE
    return {"cwd": ROOT, "stdout": pipe, "stderr": pipe, "stdin": subprocess.DEVNULL, "text": True}


@pytest.fixture(params=["link", "zenoh", "zenoh without a config"])
def place(
    request: pytest.FixtureRequest, fleet: Path
) -> Iterator[tuple[str, list[Any], list[Any]]]:
    """Give the name, and the arguments of two nodes: the shore and the vehicle."""
    if request.param == "link":
        with ChannelServer() as locator:
            words = ["--link", locator, "--config", fleet]
            yield "link", words, [*words, "--address", 2]
    else:
        with router() as (endpoint, _):
            words = ["--connect", endpoint]
            if request.param == "zenoh":
                yield (
                    "zenoh",
                    [*words, "--config", fleet],
                    [*words, "--config", fleet, "--address", 2],
                )
            else:
                yield "free", words, words


def test_pub_and_sub(place: tuple[str, list[Any], list[Any]]) -> None:
    kind, shore, vehicle = place
    value = '{ depth: 12.5, mode: "survey", }'
    with (
        started("sub", "auv1/nav", "--count", 2, "--timeout", LIMIT_S, "--json", *shore) as sub,
        started("pub", "auv1/nav", value, "--rate", 20, "--json", *vehicle) as pub,
    ):
        output, errors = sub.communicate(timeout=LIMIT_S)
        assert pub.stdout is not None
        published = json.loads(pub.stdout.readline())
    assert (sub.returncode, errors) == (0, "")
    lines = [json.loads(line) for line in output.splitlines()]
    assert len(lines) == 2
    assert lines[0]["key"] == published["key"] == "auv1/nav"
    assert lines[0]["value"] == {"depth": 12.5, "mode": "survey"}
    assert lines[0]["source"] == (2 if kind == "link" else None)


def test_call(place: tuple[str, list[Any], list[Any]]) -> None:
    kind, shore, vehicle = place

    def arm(request: Arm.Request) -> Arm.Response:
        if not request.on:
            raise RuntimeError("the battery is empty")
        return Arm.Response(ok=True)

    where = dict(zip(vehicle[::2], vehicle[1::2], strict=True))
    arguments = {word.removeprefix("--"): value for word, value in where.items()}
    with blocking.Node("auv1", **arguments) as node:
        node.create_service(Arm, "auv1/arm", arm)
        answered = run("service", "call", "auv1/arm", "{on: true}", "--json", *shore)
        assert (answered.returncode, answered.stderr) == (0, "")
        assert json.loads(answered.stdout) == {"key": "auv1/arm", "value": {"ok": True}}
        failed = run("service", "call", "auv1/arm", "{on: false}", *shore)
        assert (failed.returncode, failed.stdout) == (1, "")
        assert failed.stderr == "zacoustic service call: the battery is empty\n"
    if kind == "link":
        late = run("service", "call", "auv1/arm", "{on: true}", "--timeout", "0.2", *shore)
        assert late.returncode == 3
        assert "no answer" in late.stderr


def test_sub_without_a_key_listens_to_all_topics(fleet: Path) -> None:
    with ChannelServer() as locator:
        words = ["--link", locator, "--config", fleet]
        with (
            started("sub", "--count", 1, "--timeout", LIMIT_S, *words) as sub,
            started("pub", "note", "a text", "--rate", 20, *words, "--address", 2),
        ):
            output, errors = sub.communicate(timeout=LIMIT_S)
    assert sub.returncode == 0
    assert "listening to auv1/nav, note, fleet/{node}/status" in errors
    assert output.startswith("note: a text  (from 2, ")


def test_pub_once_waits_until_it_has_left(fleet: Path) -> None:
    with ChannelServer() as locator:
        heard = threading.Event()
        with blocking.Node("shore", config=str(fleet), link=locator) as node:
            node.create_subscription(bytes, "note", lambda sample: heard.set())
            once = run(
                "topic", "pub", "note", "x", "--link", locator, "--config", fleet, "--address", 3
            )
            assert once.returncode == 0, once.stderr
            assert once.stdout == "note: x\n"
            assert heard.wait(LIMIT_S)


def test_nothing_in_time_is_exit_code_3(place: tuple[str, list[Any], list[Any]]) -> None:
    ended = run("topic", "echo", "auv1/nav", "--timeout", "0.05", "--json", *place[1])
    assert (ended.returncode, ended.stdout) == (3, "")
    assert ended.stderr == "zacoustic topic echo: 0 of 1 samples within 0.05 s\n"


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["pub", "note", "x", "--link", "sim/127.0.0.1:1"], 2, "--link needs --config FILE"),
        (["pub", "auv1/nav", "{", "--config", "FLEET", "--address", "2"], 2, "VALUE"),
        (["pub", "auv1/nav", "{depth: 1}", "--config", "FLEET", "--address", "2"], 2, "Nav.mode"),
        (["pub", "nonsense", "x", "--config", "FLEET"], 1, "no stream is called"),
        (["pub", "note", "x", "--rate", "0", "--config", "FLEET"], 2, "--rate 0.0; allowed"),
        (["sub", "note", "--count", "-1", "--config", "FLEET"], 2, "--count -1; allowed"),
        (["call", "auv1/arm", "{on: 3}", "--config", "FLEET"], 2, "ArmRequest.on"),
        (["call", "hush", "x", "--config", "FLEET"], 1, "nobody serves it"),
        (["call", "hush", "x", "--config", "nosuch.json5"], 2, "nosuch.json5"),
    ],
)
def test_what_is_wrong_is_one_line_and_an_exit_code(
    fleet: Path, words: list[str], code: int, text: str
) -> None:
    with router() as (endpoint, _):
        where = [] if "--link" in words else ["--connect", endpoint]
        ended = run(*(str(fleet) if word == "FLEET" else word for word in words), *where)
    assert (ended.returncode, ended.stdout) == (code, "")
    assert text in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_no_router_is_exit_code_1() -> None:
    ended = run("topic", "echo", "note", "--connect", free_endpoint())
    assert ended.returncode == 1
    assert "no Zenoh router at" in ended.stderr


@pytest.mark.parametrize("verb", ["topic pub", "topic echo", "service call"])
def test_help_has_an_example(verb: str) -> None:
    ended = run(*verb.split(), "--help")
    assert ended.returncode == 0
    assert f"zacoustic {verb} " in ended.stdout.partition("examples:")[2]
