"""Who waits for a verb sees that it is at work, on a terminal and nowhere else."""

import io
import json
import os
import pty
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.node.fleet import ChannelServer
from zacoustic.app.cli import main
from zacoustic.app.cli.support import atwork
from zacoustic.app.cli.tree import whole_tree
from zacoustic.link.command import Command, CommandGroup

AT_ONCE = {
    *("config schema", "config show", "acl", "completion", "mavlink streams"),
    *("key new", "key show", "key rotate", "key revoke", "key rejoin", "key check"),
}
"""Leaves that read a file or two and print, in less than two seconds."""
RUNNING = {
    *("run gateway", "run demo", "run medium", "run modems desert", "run modems evologics"),
    *("run modems iridium", "mavlink vehicle", "mavlink shore", "monitor", "dashboard", "record"),
    "sim campaign",
}
"""Leaves that say themselves that they run, or how far they are."""
SLOW = (sys.executable, "-m", "zacoustic", "topic", "list", "--connect", "tcp/127.0.0.1:1")
"""It looks for a router for three seconds."""


def test_a_verb_of_more_than_two_seconds_says_that_it_is_at_work() -> None:
    ours, theirs = pty.openpty()
    try:
        process = subprocess.Popen(SLOW, stdout=subprocess.PIPE, stderr=theirs, text=True)
        os.close(theirs)
        told = b""
        while True:
            try:
                piece = os.read(ours, 4096)
            except OSError:  # the other end has gone
                break
            if not piece:
                break
            told += piece
        assert process.communicate(timeout=60)[0] == ""
    finally:
        os.close(ours)
    shown = told.decode().split("\r\x1b[K")
    assert any(part.startswith("zacoustic topic list: at work for ") for part in shown)
    # The last of it is taken away before what it ends with.
    assert shown[-1].startswith("zacoustic topic list: no Zenoh router")


def test_each_verb_shows_that_it_is_at_work_unless_it_is_quick_or_says_so_itself() -> None:
    assert {words for words, verb in leaves() if not verb.prints_late} == AT_ONCE | RUNNING


def leaves(words: str = "", verb: Command | None = None) -> Iterator[tuple[str, Command]]:
    """All verbs with the words to type; of `sim`, which also runs alone, its sub-verb only."""
    if verb is not None and not isinstance(verb, CommandGroup):
        yield words, verb
        return
    below = whole_tree().everything() if verb is None else verb._members
    for name, inner in below.items():
        yield from leaves(f"{words} {name}".strip(), inner)


def test_a_verb_that_knows_how_far_it_is_shows_that(monkeypatch: pytest.MonkeyPatch) -> None:
    half = threading.Event()

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

        def write(self, text: str) -> int:
            if "a verb: [==========          ]  50%, at work for " in text:
                half.set()
            return super().write(text)

    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(atwork, "_SILENT_S", 0.0)
    with atwork.AtWork().begin("a verb") as work:
        work.show(0.5)
        assert half.wait(20)


def test_what_is_no_terminal_gets_the_result_only() -> None:
    process = subprocess.run(SLOW, capture_output=True, text=True, check=False, timeout=60)
    assert (process.returncode, process.stdout) == (1, "")
    assert process.stderr.startswith("zacoustic topic list: no Zenoh router")


@pytest.mark.parametrize("reliability", ["best_effort", "reliable"])
def test_pub_ends_and_says_so_when_its_sample_became_too_old(
    reliability: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stream = {"id": 1, "topic": "note", "publishers": [1], "subscribers": [2], "linger_s": 30,
              "lifespan_s": 0.2, "reliability": reliability}  # fmt: skip
    nodes = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
    section = {"address": 1, "nodes": nodes, "streams": [stream]}
    path = tmp_path / "fleet.json5"
    path.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    with ChannelServer() as locator:
        assert main(["topic", "pub", "note", "x", "--config", str(path), "--link", locator]) == 1
    told = "1 became too old" if reliability == "best_effort" else "not delivered: expired"
    assert told in capsys.readouterr().err
