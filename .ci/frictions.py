"""What annoyed people at first use, each tried as they did: `make frictions`.

A line for each: whether it is still there, and what was found. Ends with 1 while one is open.
`tests/pages/test_frictions.py` runs the same.
"""

import contextlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final
from unittest import mock

ROOT: Final = Path(__file__).parents[1]
COLUMNS: Final = 80
FLEET: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "types": [
        {"name": "Nav", "fields": [
            {"name": "latitude_of_the_vehicle", "type": "float64", "range": [-90, 90],
             "step": 1e-6},
            {"name": "mode", "type": "enum", "values": ["idle", "survey"]}]}],
    "streams": [
        {"id": 10, "topic": "auv1/navigation/of/the/whole/vehicle", "type": "Nav",
         "publishers": [2], "codec": "packed", "min_interval_s": 60},
        {"id": 20, "service": "auv1/arm", "server": 2}],
}  # fmt: skip
TRIAL: Final[dict[str, Any]] = {
    "config": "fleet.json5", "channel": "none", "seed": 1,
    "nodes": [{"address": each, "position": [800 * each, 0, 10]} for each in (1, 2)],
    "traffic": [{"node": 2, "topic": "auv1/navigation/of/the/whole/vehicle", "every_s": 5,
                 "value": {"latitude_of_the_vehicle": 43, "mode": "survey"}}],
}  # fmt: skip

Check = Callable[[Path], str]
"""Tries one in an empty folder; returns what was found, and fails an assertion if it is open."""


class Terminal(io.StringIO):
    """A terminal of eighty columns, and what is on it."""

    def isatty(self) -> bool:
        """Tell programs so."""
        return True


def call(*arguments: object, terminal: bool = False) -> tuple[int, str, str]:
    """Run a command line here; return its exit code, its output and its errors."""
    from zacoustic.app.cli import main

    out, err = (Terminal(), Terminal()) if terminal else (io.StringIO(), io.StringIO())
    environment = mock.patch.dict(os.environ, {"COLUMNS": str(COLUMNS), "LINES": "24"})
    with environment, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(each) for each in arguments])
    return code, out.getvalue(), err.getvalue()


def fleet_in(folder: Path) -> tuple[Path, Path]:
    """Write the file of a fleet and of a trial."""
    fleet, trial = folder / "fleet.json5", folder / "trial.json5"
    fleet.write_text(json.dumps({"plugins": {"acoustic": FLEET}}), encoding="utf-8")
    trial.write_text(json.dumps(TRIAL), encoding="utf-8")
    return fleet, trial


def install_block(_: Path) -> str:
    """The commands of the README install something that is there."""
    extras = project()["optional-dependencies"]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.findall(r"pip install (?:-e )?('[^']*'|\S+)", text)
    assert found, "no pip install in the README"
    for each in found:
        match = re.fullmatch(r"'\.(?:\[([\w,-]+)\])?'", each)
        assert match, f"pip install {each}: not from a checkout, or not quoted"
        unknown = {*filter(None, (match[1] or "").split(","))} - {*extras}
        assert not unknown, f"pip install {each}: no extra {unknown}"
    return f"{len(found)} commands, from the checkout"


def extras_that_exist(_: Path) -> str:
    """The table of extras names all that a user can ask for, and none else."""
    extras = {*project()["optional-dependencies"]} - {"test", "docs"}
    text = (ROOT / "docs" / "features.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ((?:`[a-z]+`(?:, )?)+) \|", text, re.MULTILINE)
    named = {each for row in rows for each in re.findall(r"`([a-z]+)`", row)} & extras
    assert {"all", "gateway", "ros", "terminal", "console"} <= named, named
    said = {*re.findall(r"`([a-z]+)`", text)}
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md"))
    unsaid = {each for each in extras - said if each not in pages}
    assert not unsaid, f"no page names the extra {unsaid}"
    return f"{len(extras)} extras, each named by a page"


def blocking_import(folder: Path) -> str:
    """`import zacoustic` is enough for `zacoustic.blocking.Node`."""
    done = python("import zacoustic; print(zacoustic.blocking.Node.__name__)", folder)
    assert done.stdout == "Node\n", done.stderr
    return "zacoustic.blocking.Node without an import of its own"


def exported_events(_: Path) -> str:
    """What `Node.events()` gives can be named by `from zacoustic import …`."""
    import zacoustic
    from zacoustic.zenoh.node import NodeEvent

    given = typing.get_args(NodeEvent)
    assert len(given) > 10, given
    absent = [each.__name__ for each in given if not hasattr(zacoustic, each.__name__)]
    assert not absent, f"not exported: {absent}"
    return f"{len(given)} events"


def action_example(folder: Path) -> str:
    """An example sends a goal, shows feedback and cancels."""
    made = [each for each in (ROOT / "examples").glob("[0-9]*.py")
            if "create_action_server" in each.read_text(encoding="utf-8")]  # fmt: skip
    assert made, "no example has an action"
    done = subprocess.run(
        [sys.executable, str(made[0])], cwd=folder, capture_output=True, text=True, timeout=120,
        env=environment(), check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "SUCCEEDED" in done.stdout, done.stdout
    assert "CANCELED" in done.stdout, done.stdout
    return made[0].name


def progress(folder: Path) -> str:
    """A verb that takes its time says on a terminal that it is at work."""
    from zacoustic.app.cli.support import atwork

    _, trial = fleet_in(folder)
    with mock.patch.object(atwork, "_SILENT_S", 0.0), mock.patch.object(atwork, "_EVERY_S", 0.01):
        code, _, err = call("sim", trial, "--until", 3000, terminal=True)
    assert code == 0, err
    assert re.search(r"zacoustic sim.*\d+ s", err), "nothing was shown"
    _, _, err = call("sim", trial, "--until", 100)
    assert err == "", "a log is disturbed"
    return "the running time from the third second on, on a terminal only"


def eighty_columns(folder: Path) -> str:
    """No table and no help is wider than a terminal of eighty columns."""
    from zacoustic.app.cli.verbs import VERBS

    fleet, trial = fleet_in(folder)
    recording = folder / "trial.mcap"
    wide: list[str] = []
    for arguments in (
        ("config", "check", fleet), ("config", "plan", trial),
        ("sim", trial, "--until", 300, "--record", recording), ("report", recording),
        ("codec", "bench", recording, "--config", fleet),
    ):  # fmt: skip
        code, out, err = call(*arguments, terminal=True)
        assert code in (0, 1), (arguments, err)
        tables = [line for line in out.splitlines() if re.search(r"\S  +\S.*\S  +\S", line)]
        assert tables, arguments
        wide += [f"{arguments[0]}: {line}" for line in tables if len(line) > COLUMNS]
    verbs = ["", *VERBS, "run medium", "run modems evologics"]
    for verb in verbs:
        _, out, _ = call(*verb.split(), "--help", terminal=True)
        wide += [f"{verb} --help: {line}" for line in out.splitlines() if len(line) > COLUMNS]
    assert not wide, wide[0]
    code, out, _ = call("config", "check", fleet)
    assert max(map(len, out.splitlines())) > COLUMNS, "a log has a row in one line"
    return f"the tables of five verbs, the help of {len(verbs)}; in a log a row is a line"


def edits_after_init(folder: Path) -> str:
    """The file that `config init` writes of a live network is valid as it is."""
    first = folder / "first.json5"
    with live_network() as endpoint:
        code, _, err = call(
            "config", "init", "--connect", endpoint, "--listen-s", 0.5, "--output", first
        )
    assert code == 0, err
    code, out, err = call("config", "check", first, "--json")
    assert code == 0, err
    names = {row["name"] for row in json.loads(out)["streams"]}
    assert {"auv1/nav", "auv1/status"} <= names, names
    return "0 lines edited by hand"


def thinning(folder: Path) -> str:
    """What `min_interval_s` leaves out is not shown as lost."""
    _, trial = fleet_in(folder)
    recording = folder / "trial.mcap"
    assert call("sim", trial, "--until", 600, "--record", recording)[0] == 0
    code, out, err = call("report", recording)
    assert code == 0, err
    assert re.search(r"\d+ of 1\d\d left out on purpose by min_interval_s", out), out
    assert "did not arrive" not in out.partition("\n\n")[0], out
    return "left out on purpose"


def exit_codes(folder: Path) -> str:
    """One rule: 0 done, 1 failed, 2 wrong arguments or file, 3 no answer in time."""
    fleet, _ = fleet_in(folder)
    wrong = folder / "wrong.json5"
    wrong.write_text('{ plugins: { acoustic: { address: "x" } } }', encoding="utf-8")
    nowhere = "tcp/127.0.0.1:9"
    cases: list[tuple[int, tuple[object, ...]]] = [
        (0, ("config", "check", fleet)), (2, ("config", "check", wrong)),
        (2, ("config", "check", folder / "absent.json5")), (2, ("config", "chekc", fleet)),
        (2, ("decode", "--bogus")), (1, ("decode", "xyz")),
        (1, ("topic", "echo", "a", "--connect", nowhere)), (0, ("--version",)),
    ]  # fmt: skip
    for expected, arguments in cases:
        code, _, err = call(*arguments)
        assert code == expected, f"{arguments}: {code} in place of {expected}: {err}"
        assert (err == "") == (expected == 0), (arguments, err)
        assert err.count("\n") <= 1, f"{arguments}: more than a line: {err}"
    with live_network() as endpoint:
        code, _, err = call("topic", "echo", "silent", "--connect", endpoint, "--timeout", 0.2)
    assert (code, err.count("\n")) == (3, 1), f"nothing arrives: {code} in place of 3: {err}"
    return f"{len(cases) + 1} calls, a line for each error"


def completion(folder: Path) -> str:
    """The shell completes verbs, and the streams and nodes of the file."""
    fleet, _ = fleet_in(folder)
    for shell in ("bash", "zsh", "fish"):
        code, out, err = call("completion", shell)
        assert code == 0, err
        assert "predive" in out, shell
    said = {}
    for kind in ("topic", "service", "node"):
        line = f"zacoustic topic echo --config {fleet} "
        code, out, err = call("completion", "--names", kind, "--line", line)
        assert code == 0, err
        said[kind] = out.split()
    expected = {"topic": ["auv1/navigation/of/the/whole/vehicle"], "service": ["auv1/arm"]}
    assert {kind: said[kind] for kind in expected} == expected, said
    assert {"1", "2"} <= {*said["node"]}, said
    return "verbs, streams, nodes; three shells"


CHECKS: Final[tuple[Check, ...]] = (
    install_block, extras_that_exist, blocking_import, exported_events, action_example, progress,
    eighty_columns, edits_after_init, thinning, exit_codes, completion,
)  # fmt: skip


def main() -> int:
    """Try all, and print a line for each."""
    left = 0
    for check in CHECKS:
        began_s, mark = time.monotonic(), "ok  "
        with tempfile.TemporaryDirectory() as folder:
            try:
                found = check(Path(folder))
            except AssertionError as error:
                left += 1
                mark, found = "OPEN", str(error).partition("\n")[0][:COLUMNS]
        name = check.__name__.replace("_", " ")
        print(f"{mark}  {name:18}  {time.monotonic() - began_s:4.1f} s  {found}")
    return 1 if left else 0


# Below the functions above


def project() -> dict[str, Any]:
    """Return the metadata of the project."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    found: dict[str, Any] = tomllib.loads(text)["project"]
    return found


def environment() -> dict[str, str]:
    """Return one in which Python finds this checkout."""
    return {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'links'}"}


def python(program: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a line of Python in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, timeout=60,
        env=environment(), check=False,
    )  # fmt: skip


@contextlib.contextmanager
def live_network() -> Iterator[str]:
    """Run a router on which a vehicle publishes; gives its endpoint."""
    import cbor2
    import zenoh

    from zacoustic.app.tools.demo.networks import free_ports

    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    settings = {
        "mode": "router", "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}}, "adminspace": {"enabled": True},
    }  # fmt: skip
    ended = threading.Event()

    def publish(session: zenoh.Session) -> None:
        count = 0
        while not ended.wait(0.02):
            count += 1
            nav = {"lat": 43.1 + count * 1e-5, "depth": 10.5, "count": count}
            session.put("auv1/nav", cbor2.dumps(nav), encoding="application/cbor")
            session.put("auv1/status", '{"ok": true}', encoding="application/json")

    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        thread = threading.Thread(target=publish, args=(session,))
        thread.start()
        try:
            yield endpoint
        finally:
            ended.set()
            thread.join()


if __name__ == "__main__":
    sys.exit(main())
