"""Every verb in every hostile situation: an exit code of its own, no traceback, no file lost.

The whole table runs in the soak, a share of it that differs by no seed in `make test`. Nothing in
it needs a network: what would join one finds nobody at port 1 of this computer.
"""

import argparse
import json
import os
import random
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.gateway.networks import zenoh_router
from zacoustic.app.cli import complete_parser, main
from zacoustic.app.cli.support.newfile import new_file
from zacoustic.core.base.journal import JournalWrite
from zacoustic.mavlink.entries import entries
from zacoustic.run.journal import journal_in

PROGRAM: Final = (sys.executable, "-m", "zacoustic")
NOBODY: Final = ("--connect", "tcp/127.0.0.1:1")
NO_MEDIUM: Final = "sim/127.0.0.1:1#wait_s=0.1"
NO_HOST: Final = "256.0.0.1:0"
CODES: Final = {0, 1, 2, 3}
TRACES: Final = ("Traceback", "Exception ignored", "Logging error", "Fatal Python error")

FLEET: Final = """{ plugins: { acoustic: { address: 1,
  nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv–µ\U0001f916" } ],
  types: [ { name: "Nav", fields: [
    { name: "depth", type: "float32", range: [0, 100], step: 0.1 } ] } ],
  streams: [ { id: 1, topic: "hello", min_interval_s: 10 },
             { id: 2, topic: "nav", type: "Nav", min_interval_s: 20, publishers: [2],
               codec: "dense" },
             { id: 3, service: "arm", server: 2 } ] } } }"""
CHANNEL: Final = """{ channel: "none", config: "fleet.json5",
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [100, 0, 10] } ],
  traffic: [ { node: 2, topic: "nav", every_s: 10, value: { depth: 3 } },
             { node: 1, topic: "hello", every_s: 20, size_bytes: 8 } ] }"""


CAMPAIGN: Final = """{ scenario: "water.json5", until_s: 60, seeds: 1,
  sweep: [ { key: "loss.frame", values: [0, 0.2] } ] }"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a user: a file of each kind that verbs read."""
    made = tmp_path_factory.mktemp("user")
    (made / "fleet.json5").write_text(FLEET, encoding="utf-8")
    (made / "water.json5").write_text(CHANNEL, encoding="utf-8")
    bridged = {"address": 1, **entries("auv1/mavlink", vehicle=2, shore=1, first_id=60)}
    section = json.dumps({"plugins": {"acoustic": bridged}})
    (made / "mavlink.json5").write_text(section, encoding="utf-8")
    (made / "campaign.json5").write_text(CAMPAIGN, encoding="utf-8")
    lines = (f'{{"t": {i}, "s": "nav", "v": {{"depth": {i % 50}}}}}\n' for i in range(200))
    (made / "nav.jsonl").write_text("".join(lines), encoding="utf-8")
    words = ["sim", str(made / "water.json5"), "--until", "300", "--record"]
    assert main([*words, str(made / "trial.mcap")]) == 0
    return made


LINKED: Final = ("--config", "fleet.json5", "--link", NO_MEDIUM)
BRIDGE: Final = ("mavlink.json5", "--mavlink", "udpin:127.0.0.1:0", *NOBODY)
VERBS: Final[dict[str, tuple[str, ...]]] = {
    "run gateway": (
        "run",
        "gateway",
        "fleet.json5",
        "--link",
        NO_MEDIUM,
        "--listen",
        "tcp/127.0.0.1:0",
    ),
    "config check": ("config", "check", "fleet.json5"),
    "config plan": ("config", "plan", "water.json5", "--hours", "0.1"),
    "config doctor": ("config", "doctor", "fleet.json5", "--link", NO_MEDIUM, "--patience", "0.2"),
    "links": ("links",),
    "topic pub": ("topic", "pub", "hello", "x", *LINKED),
    "topic echo": ("topic", "echo", "--timeout", "1", *LINKED),
    "service call": ("service", "call", "arm", "x", "--timeout", "1", *LINKED),
    "action send_goal": ("action", "send_goal", "goto", "x", *NOBODY),
    "ping": ("ping", "2", *NOBODY),
    "route show": ("route", "show", "fleet.json5", *NOBODY),
    "route probe": ("route", "probe", "--config", "fleet.json5", *NOBODY),
    "route set": ("route", "set", "1", "--path", "1,2", "--config", "fleet.json5", *NOBODY),
    "route reset": ("route", "reset", "1", "--config", "fleet.json5", *NOBODY),
    "mavlink vehicle": ("mavlink", "vehicle", *BRIDGE),
    "mavlink shore": ("mavlink", "shore", *BRIDGE),
    "mavlink streams": ("mavlink", "streams"),
    "topic list": ("topic", "list", *NOBODY),
    "topic hz": ("topic", "hz", "hello", "--timeout", "1", *LINKED),
    "topic bw": ("topic", "bw", "hello", *NOBODY),
    "topic info": ("topic", "info", "hello", *NOBODY),
    "status": ("status", *NOBODY),
    "nodes": ("nodes", *NOBODY),
    "config show": ("config", "show", "fleet.json5"),
    "service list": ("service", "list", *NOBODY),
    "action list": ("action", "list", *NOBODY),
    "monitor": ("monitor", "--once", *NOBODY),
    "dashboard": ("dashboard", "--listen", NO_HOST, *NOBODY),
    "silence": ("silence", *NOBODY),
    "resume": ("resume", *NOBODY),
    "stream": ("stream", "1", "--node", "2", *NOBODY),
    "decode": ("decode", "trial.mcap"),
    "sim": ("sim", "water.json5", "--until", "60"),
    "sim campaign": ("sim", "campaign", "campaign.json5", "--workers", "1"),
    "record": ("record", "-o", "new.mcap", *NOBODY),
    "replay": ("replay", "trial.mcap", "--check"),
    "report": ("report", "trial.mcap"),
    "config init": ("config", "init", *NOBODY),
    "config schema": ("config", "schema"),
    "codec fit": ("codec", "fit", "nav.jsonl", "--config", "fleet.json5"),
    "codec bench": ("codec", "bench", "nav.jsonl", "--config", "fleet.json5"),
    "completion": ("completion", "bash"),
    "run demo": ("run", "demo", "--duration", "7"),
    "run medium": ("run", "medium", "water.json5", "--listen", NO_HOST),
    "run modems desert": ("run", "modems", "desert", "--listen", NO_HOST),
    "run modems evologics": ("run", "modems", "evologics", "--listen", NO_HOST),
    "run modems iridium": ("run", "modems", "iridium", "--listen", NO_HOST),
    "acl": ("acl", "fleet.json5"),
    "audit": ("audit", "node-2.audit"),
    "predive": ("predive", "fleet.json5", *NOBODY),
    "key new": ("key", "new", "new.key", "--network", "harbour"),
    "key show": ("key", "show", "fleet.key"),
    "key rotate": ("key", "rotate", "fleet.key"),
    "key revoke": ("key", "revoke", "fleet.members", "2"),
    "key rejoin": ("key", "rejoin", "2", "--config", "fleet.json5", "--never"),
    "key check": ("key", "check", "fleet.json5"),
    "key send": ("key", "send", "--node", "2", "--source", "3", *NOBODY),
}
"""How each verb is called, so that it ends soon."""
SITUATIONS: Final = {
    "input closed": "<&-",
    "output closed": ">&-",
    "errors closed": "2>&-",
    "everything closed": "<&- >&- 2>&-",
    "disk full": ">/dev/full",
    "disk full, errors too": ">/dev/full 2>/dev/full",
    "reader gone": "| head -c 1",
    "ASCII": "PYTHONIOENCODING=ascii",
    "ASCII, JSON": "PYTHONIOENCODING=ascii --json",
    "no locale": "LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0",
}


def leaves(
    parser: argparse.ArgumentParser, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    below = [each for each in parser._actions if isinstance(each, argparse._SubParsersAction)]
    if not below or not below[0].required:
        yield words, parser
    for each in below:
        for name, inner in each.choices.items():
            yield from leaves(inner, (*words, name))


def command_of(words: tuple[str, ...], situation: str) -> str:
    """A line of a shell."""
    change = SITUATIONS[situation]
    settings = [word for word in change.split() if "=" in word]
    flags = ["--json"] if "--json" in change and words[0] != "completion" else []
    redirected = "" if settings else change
    return f"{' '.join(settings)} {shlex.join([*PROGRAM, *words, *flags])} {redirected}"


def check_end(process: subprocess.CompletedProcess[str], what: object) -> None:
    told = process.stderr + process.stdout
    assert process.returncode in CODES, (what, process.returncode, told)
    assert not any(trace in told for trace in TRACES), (what, told)


def shell(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, errors="replace", cwd=folder,
        timeout=300, check=False,
    )  # fmt: skip


def test_every_verb_is_in_the_table() -> None:
    known = {" ".join(words) for words, _ in leaves(complete_parser())}
    assert known - {each for each in known if each.startswith("journal")} == set(VERBS)


@pytest.mark.parametrize(("words", "parser"), list(leaves(complete_parser())))
def test_every_verb_has_an_example_and_says_what_is_wrong(
    words: tuple[str, ...], parser: argparse.ArgumentParser, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--help"]) == 0
    assert "zacoustic " + " ".join(words) in capsys.readouterr().out.partition("example")[2]
    assert main([*words, "--no-such-flag"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    has_json = any("--json" in each.option_strings for each in parser._actions)
    assert has_json or words == ("completion",)


def test_no_situation_of_its_streams_brings_a_traceback(
    folder: Path, count: Callable[[int], int]
) -> None:
    table = [(verb, situation) for verb in VERBS for situation in SITUATIONS]
    random.Random("streams").shuffle(table)
    for verb, situation in table[: count(700)]:
        command = command_of(VERBS[verb], situation)
        check_end(shell(command, folder), command)


def test_each_situation_of_the_streams_at_one_verb(folder: Path) -> None:
    for situation in ("everything closed", "disk full", "ASCII, JSON"):
        process = shell(command_of(("config", "check", "fleet.json5"), situation), folder)
        check_end(process, situation)
        assert process.returncode == (1 if situation == "disk full" else 0)
        if situation == "disk full":
            assert process.stderr == "zacoustic config check: No space left on device\n"
        if "JSON" in situation:
            assert process.stdout.isascii()
            assert json.loads(process.stdout)["nodes"]["2"] == "auv–µ\U0001f916"


def bad_files(folder: Path) -> dict[str, str]:
    """Make what is no file of ours; by name."""
    made = folder / "bad"
    made.mkdir(exist_ok=True)
    (made / "empty").write_bytes(b"")
    (made / "noise").write_bytes(random.Random(1).randbytes(3000))
    (made / "cut.mcap").write_bytes((folder / "trial.mcap").read_bytes()[:5000])
    (made / "number.json5").write_text("1e308")
    (made / "list.json5").write_text("[1, 2]")
    (made / "deep.json5").write_text("[" * 5000)
    (made / "nothing.json5").write_text("{ plugins: { acoustic: {} } }")
    for name, target in (("loop", "loop"), ("dangling", "nowhere")):
        if not (made / name).is_symlink():
            (made / name).symlink_to(made / target)
    places = {each.name: str(each) for each in made.iterdir()}
    return places | {
        "missing": str(made / "missing"), "folder": str(made), "here": ".", "device": "/dev/null",
        "long": "x" * 300, "none": "",
    }  # fmt: skip


def test_no_file_that_is_none_brings_a_traceback(
    folder: Path, count: Callable[[int], int], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    files = bad_files(folder)
    readers = [
        words
        for words in VERBS.values()
        if {"fleet.json5", "water.json5", "campaign.json5"} & set(words)
    ]
    readers += [VERBS["decode"], VERBS["replay"], VERBS["report"]]
    readers = [words for words in readers if words[:2] not in NETWORKED]
    table = [
        (words, at, path)
        for words in readers
        for at, word in enumerate(words)
        if (folder / word).is_file()
        for path in files.values()
    ]
    random.Random("files").shuffle(table)
    for words, at, path in table[: max(40, count(1000))]:
        called = [*words[:at], path, *words[at + 1 :]]
        assert main(called) in CODES, called
        written = capsys.readouterr()
        assert not any(trace in written.err for trace in TRACES), called


NETWORKED: Final = (
    ("run", "gateway"), ("topic", "pub"), ("topic", "echo"), ("topic", "hz"), ("service", "call"),
)  # fmt: skip
"""They join a network before they read their file, or wait for one."""
NUMBERS: Final = {
    float: ("1e308", "1e-300", "-1e308", "0", "nan", "inf"),
    int: ("99999999999999999999", "0", "-1"),
}


def test_no_number_brings_a_traceback(
    folder: Path, count: Callable[[int], int], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    in_process = {"sim", "ping", "stream", "silence", "monitor", "config", "codec", "run"}
    table = [
        (VERBS[" ".join(words)], f"{each.option_strings[-1]}={number}")
        for words, parser in leaves(complete_parser())
        if words[0] in in_process and words not in (("run", "gateway"), ("config", "doctor"))
        for each in parser._actions
        if each.type in NUMBERS and each.option_strings and each.dest != "random"
        for number in NUMBERS[each.type]
    ]
    random.Random("numbers").shuffle(table)
    for words, option in table[: count(1500)]:
        assert main([*words, option]) in CODES, option
        written = capsys.readouterr()
        assert not any(trace in written.err for trace in TRACES), option


WRITERS: Final = {
    "report": ("report", "trial.mcap", "--html"),
    "trace": ("sim", "water.json5", "--until", "60", "--trace"),
    "sim": ("sim", "water.json5", "--until", "60", "--record"),
    "fit": ("codec", "fit", "nav.jsonl", "--config", "fleet.json5", "--output"),
    "init": ("config", "init", *NOBODY, "--output"),
    "demo": ("run", "demo", "--screenshot"),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_nothing_is_written_over_a_file_that_is_there(
    writer: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    there, link = tmp_path / "there", tmp_path / "link"
    there.write_bytes(b"what the user has")
    link.symlink_to(there)
    for path in (there, link, tmp_path):
        code = main([*WRITERS[writer], str(path)])
        assert code == 2 or (writer == "sim" and path != tmp_path), path  # a name of its own
        assert there.read_bytes() == b"what the user has"
        assert "Traceback" not in capsys.readouterr().err


def test_a_page_of_a_report_replaces_no_recording(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    before = (folder / "trial.mcap").read_bytes()
    assert main(["report", "--html", "trial.mcap", "trial.mcap"]) == 2
    assert "--html trial.mcap exists; allowed: a new file" in capsys.readouterr().err
    assert (folder / "trial.mcap").read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ("report", "fleet.json5", "--html"),
        ("sim", "fleet.json5", "--trace"),
        ("codec", "fit", "trial.mcap", "--config", "water.json5", "--output"),
        ("config", "init", *NOBODY, "--output"),
    ],
)
def test_who_refuses_leaves_no_file_behind(
    words: tuple[str, ...], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert main([*words, str(tmp_path / "new")]) in {1, 2}
    assert list(tmp_path.iterdir()) == []


INTERRUPTING: Final = """
import os, signal, sys
left = int(os.environ.pop("INTERRUPT_AT"))
def interrupt(event, arguments):
    global left
    if event == "import" and left >= 0:
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGINT)
"""
STARTED: Final = """
import runpy, sys
import zacoustic.errors
sys.argv[:] = ["zacoustic", *sys.argv[1:]]
sys.addaudithook(interrupt)
runpy.run_module("zacoustic", run_name="__main__", alter_sys=True)
"""


def test_an_interrupt_at_any_import_ends_it_without_a_word(
    folder: Path, count: Callable[[int], int]
) -> None:
    rng = random.Random("interrupts")
    for _ in range(count(400)):
        at, words = rng.randrange(3, 250), rng.choice([VERBS["config check"], VERBS["config plan"]])
        process = subprocess.run(
            [sys.executable, "-c", INTERRUPTING + STARTED, *words], capture_output=True, text=True,
            cwd=folder, timeout=120, check=False, env={**os.environ, "INTERRUPT_AT": str(at)},
        )  # fmt: skip
        assert process.returncode in {0, 1, 130, -2}, (at, words)
        assert process.stderr == "", (at, words)


IN_A_MODULE_IN_C: Final = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # also in a shell's background job
seen = []
def interrupt(event, arguments):
    if event == "import" and seen != ["over"]:
        if seen:
            seen[:] = ["over"]
            os.kill(os.getpid(), signal.SIGINT)
        elif arguments[0] == "msgspec._core" and arguments[1]:
            seen.append("begun")
sys.addaudithook(interrupt)
"""


def test_an_interrupt_that_a_module_in_c_drops_ends_what_serves(tmp_path: Path) -> None:
    """Such modules import others while they begin, and drop any exception that comes then."""
    (tmp_path / "sitecustomize.py").write_text(IN_A_MODULE_IN_C)
    with zenoh_router() as port:
        words = ["monitor", "--json", "--connect", f"tcp/127.0.0.1:{port}"]
        process = subprocess.run(
            [sys.executable, "-m", "zacoustic", *words], capture_output=True, text=True,
            timeout=60, check=False, env={**os.environ, "PYTHONPATH": str(tmp_path)},
        )  # fmt: skip
    assert process.returncode in {130, -2}
    assert process.stderr == ""


def test_a_journal_that_is_a_link_is_that_of_the_file(tmp_path: Path) -> None:
    kept, links = tmp_path / "kept", tmp_path / "links"
    links.mkdir()
    first = journal_in(links, 1)
    first.path.symlink_to(kept)
    kept.write_bytes(b"")
    epochs = []
    for _ in range(2):
        journal = journal_in(links, 1)
        epochs.append(journal.recover().boot_epoch)
        journal.commit([JournalWrite(write_id=0, key="k", value=b"v")])
        journal.close()
    assert epochs[1] != epochs[0]
    assert journal_in(links, 1).path == kept


@pytest.mark.parametrize(("written", "stays"), [(b"", False), (b"the trace of hours\n", True)])
def test_an_interrupt_keeps_what_was_written_and_no_empty_file(
    written: bytes, stays: bool, tmp_path: Path
) -> None:
    path = tmp_path / "trace.jsonl"

    def work() -> None:
        with new_file("--trace", path) as file:
            assert file is not None
            file.write(written)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert path.exists() == stays
