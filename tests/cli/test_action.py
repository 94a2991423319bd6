"""`zacoustic action send_goal`: results, feedback, rejection, Ctrl-C, nobody, on link and Zenoh."""

import json
import os
import signal
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.node.fleet import SECTION, ChannelServer, Goto, router
from tests.node.test_verbs import LIMIT_S, run, started
from zacoustic import blocking

Handle = blocking.ServerGoalHandle[Goto.Goal, Goto.Feedback, Goto.Result]
GOAL = ["action", "send_goal", "auv1/goto"]


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.json5"
    path.write_text(json.dumps({"plugins": {"acoustic": SECTION}}), encoding="utf-8")
    return path


@pytest.fixture(params=["link", "zenoh"])
def place(request: pytest.FixtureRequest, fleet: Path) -> Iterator[dict[str, Any]]:
    """Give the arguments of a node, as the API has them."""
    if request.param == "link":
        with ChannelServer() as locator:
            yield {"config": str(fleet), "link": locator}
    else:
        with router() as (endpoint, _):
            yield {"config": str(fleet), "connect": endpoint}


def words_of(place: dict[str, Any]) -> list[str]:
    return [word for name, value in place.items() for word in (f"--{name}", value)]


def pursue(handle: Handle) -> Goto.Result:
    """Go there; where it is deep, wait to be cancelled."""
    handle.publish_feedback(Goto.Feedback(left=handle.request.depth))
    if handle.request.depth > 100:
        assert handle.wait_cancel(timeout_s=LIMIT_S)
        handle.canceled()
    elif handle.request.depth < 1:
        handle.abort()
    else:
        handle.succeed()
    return Goto.Result(depth=handle.request.depth)


def lines(process: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in process.stdout.splitlines()]


def test_goals_end_as_the_server_says(place: dict[str, Any]) -> None:
    where = words_of(place)
    with blocking.Node("auv1", **place) as node:
        node.create_action_server(
            Goto, "auv1/goto", pursue, goal_callback=lambda goal: goal.depth < 1000
        )
        done = run(*GOAL, "{ depth: 12.5 }", "--feedback", "--json", *where)
        assert (done.returncode, done.stderr) == (0, "")
        accepted, *feedback, result = lines(done)
        assert accepted == {"action": "auv1/goto", "event": "accepted", "text": ""}
        assert all(each["value"] == {"left": 12.5} for each in feedback)
        assert (result["status"], result["value"]) == ("succeeded", {"depth": 12.5})
        aborted = run(*GOAL, "{ depth: 0.5 }", *where)
        assert aborted.returncode == 1
        assert aborted.stdout == 'accepted\naborted: {"depth": 0.5}\n'
        rejected = run(*GOAL, "{ depth: 5000 }", "--json", *where)
        assert rejected.returncode == 1
        assert lines(rejected)[0]["event"] == "rejected"
        late = run(*GOAL, "{ depth: 500 }", "--timeout", "0.5", *where)
        assert late.returncode == 3
        assert "not ended within 0.5 s; it goes on" in late.stdout


def test_ctrl_c_cancels_the_goal_and_waits_for_its_end(place: dict[str, Any]) -> None:
    with blocking.Node("auv1", **place) as node:
        node.create_action_server(Goto, "auv1/goto", pursue)
        with started(*GOAL, "{ depth: 500 }", "--json", *words_of(place)) as process:
            assert process.stdout is not None
            assert json.loads(process.stdout.readline())["event"] == "accepted"
            os.kill(process.pid, signal.SIGINT)
            output, errors = process.communicate(timeout=LIMIT_S)
    assert (process.returncode, errors) == (130, "")
    assert json.loads(output)["status"] == "canceled"


def test_a_second_ctrl_c_does_not_wait(fleet: Path) -> None:
    left = threading.Event()

    def stubborn(handle: Handle) -> Goto.Result:
        assert left.wait(LIMIT_S)
        handle.succeed()
        return Goto.Result(depth=0.0)

    with router() as (endpoint, _):
        place: dict[str, Any] = {"config": str(fleet), "connect": endpoint}
        with blocking.Node("auv1", **place) as node:
            node.create_action_server(
                Goto, "auv1/goto", stubborn, cancel_callback=lambda handle: False
            )
            with started(*GOAL, "{ depth: 5 }", *words_of(place)) as process:
                assert process.stdout is not None
                assert process.stderr is not None
                assert process.stdout.readline() == "accepted\n"
                os.kill(process.pid, signal.SIGINT)
                assert "the server does not cancel it" in process.stderr.readline()
                os.kill(process.pid, signal.SIGINT)
                process.communicate(timeout=LIMIT_S)
            left.set()
            assert process.returncode == 130


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["auv1/goto", "{depth: 3}"], 2, "give --config FILE"),
        (["auv1/goto", "{depth: 'x'}", "--config", "FLEET"], 2, "GotoGoal.depth"),
        (["auv1/goto", "{depth: 1}", "--config", "FLEET"], 1, "nobody serves"),
        (["note", "x", "--config", "FLEET"], 1, "not an action"),
    ],
)
def test_what_is_wrong_with_a_goal_is_one_line_and_an_exit_code(
    fleet: Path, words: list[str], code: int, text: str
) -> None:
    with router() as (endpoint, _):
        written = [str(fleet) if word == "FLEET" else word for word in words]
        ended = run("action", "send_goal", *written, "--connect", endpoint)
    assert (ended.returncode, ended.stdout) == (code, ""), ended.stderr
    assert text in ended.stderr
    assert ended.stderr.count("\n") == 1
