"""`zacoustic run demo`: once over each link, as a user starts it, and its refusals."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from zacoustic.app.cli import main
from zacoustic.app.tools.demo.media import MEDIA

# Sound needs 0.667 s, the shortest frame 0.16 s more; with DESERT 0.333 s, and it listens 0.1 s.
QUICKEST_S = {"sim": 0.8, "evologics": 0.8, "evologics-serial": 0.8, "desert": 0.4}
PROGRAM = [sys.executable, "-m", "zacoustic", "run", "demo", "--duration", "20"]


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*PROGRAM, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


LINKS = [link for link in MEDIA if link != "evologics-serial" or sys.platform != "win32"]


@pytest.mark.parametrize("link", LINKS)
def test_everything_crosses_and_every_line_is_json(link: str) -> None:
    with start("--json", "--link", link) as process:
        output, errors = process.communicate(timeout=90)
    lines: list[dict[str, Any]] = [json.loads(line) for line in output.splitlines()]
    summary = lines[-1]
    assert summary["event"] == "summary"
    assert summary["missing"] == []
    assert errors == ""
    assert process.returncode == 0
    assert summary["ok"] is True
    lanes = {lane["stream"]: lane for lane in summary["streams"]}
    assert set(lanes) == {
        "auv1/nav", "fleet/{node}/status", "auv1/waypoint", "auv1/arm request",
        "auv1/arm response",
    }  # fmt: skip
    assert all(lane["crossed"] > 0 for lane in lanes.values())
    for name, lane in lanes.items():
        # What is sent once may meet another frame in the water, and is told to be lost then.
        lost = 0 if name.startswith("auv1/arm") else summary["lost_frames"]
        assert lane["sent"] - lost <= lane["crossed"] <= lane["sent"]
    assert all(QUICKEST_S[link] < lane["mean_delay_s"] < 5 for lane in lanes.values())
    streams_bytes = sum(lane["transmitted_bytes"] for lane in lanes.values())
    assert streams_bytes + summary["overhead_bytes"] == summary["transmitted_bytes"]
    assert {line["event"] for line in lines} == {
        "started", "sent", "emitted", "arrived", "crossed", "summary"
    }  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 1)])
def test_a_signal_stops_all_processes(number: signal.Signals, code: int) -> None:
    with start("--json") as process:
        assert process.stdout is not None
        for line in process.stdout:
            if json.loads(line)["event"] == "emitted":
                break
        children = children_of(process.pid)
        for _ in range(3):  # somebody is impatient
            process.send_signal(number)
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (code, "")
    assert len(children) == 5
    assert [pid for pid in children if is_alive(pid)] == []


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_gateway_that_dies_ends_the_demo_and_is_named() -> None:
    with start("--json") as process:
        assert process.stdout is not None
        for line in process.stdout:
            if json.loads(line)["event"] == "emitted":
                break
        children = children_of(process.pid)
        (gateway,) = [pid for pid in children if "auv1.json5" in command_of(pid)]
        os.kill(gateway, signal.SIGKILL)
        output, _ = process.communicate(timeout=30)
    assert process.returncode == 1
    summary = json.loads(output.splitlines()[-1])
    assert summary["missing"][0].startswith("gateway auv1 ended with code -9")
    assert [pid for pid in children if is_alive(pid)] == []


def test_an_unknown_link_is_refused_with_those_that_are_there(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["run", "demo", "--link", "tea"]) == 2
    assert (
        "--link tea; allowed: sim, evologics, evologics-serial, desert" in capsys.readouterr().err
    )


@pytest.mark.parametrize("duration", ["5", "600", "nan"])
def test_a_duration_out_of_range_is_refused(
    duration: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "demo", "--duration", duration]) == 2
    assert "allowed: 20..40 s" in capsys.readouterr().err


def children_of(parent: int) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            # pid (name) state parent …; the name may hold anything
            fields = path.read_text(encoding="utf-8").rpartition(")")[2].split()
            if int(fields[1]) == parent:
                found.append(int(path.parent.name))
    return found


def command_of(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
