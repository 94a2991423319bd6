"""`zacoustic sim campaign`: every cell with every seed, whoever dies; and what it refuses."""

import contextlib
import csv
import gc
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec
import pytest

pytest.importorskip("distributed", reason="NOT RUN: zacoustic[campaign] is not installed")

from zacoustic.app.cli import main
from zacoustic.app.tools.design.campaign.campaign import campaign_of
from zacoustic.app.tools.design.campaign.running import Batch, run_batch, version
from zacoustic.app.tools.design.campaign.spec import read_spec

SCENARIO: Final = """{ config: "fleet.json5",
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [1000, 0, 50] },
           { address: 3, position: [0, 800, 20] } ],
  links: [ { from: 3, to: 1, loss: { frame: 0.1 } } ],
  traffic: [ { node: 2, topic: "nav", every_s: 20, pattern: "random", vary: { depth: [0, 90] },
               value: { mode: "hold" } },
             { node: 3, topic: "raw", every_s: 30, pattern: "random", size_bytes: [8, 30] } ] }"""
FLEET: Final = """{ plugins: { acoustic: {
  types: [ { name: "Nav", fields: [ { name: "depth", type: "float32" },
                                    { name: "mode", type: "string" } ] } ],
  streams: [ { id: 1, topic: "nav", type: "Nav" }, { id: 2, topic: "raw" } ] } } }"""
CAMPAIGN: Final = """{ scenario: "water.json5", until_s: 300, seeds: 4,
  sweep: [ { key: "loss.frame", name: "loss", values: [0, 0.3] },
           { key: "config.streams[0].codec", name: "codec", values: ["cbor", "packed"] },
           { name: "fleet", cases: [ { name: "three", set: {} },
                                     { name: "far", set: { "nodes[1].position[0]": 2000 } } ] } ],
  figures: ["delivery", "nav: p95_s"] }"""
RUNS: Final = 2 * 2 * 2 * 4
NAMES: Final = ("runs.csv", "cells.csv", "page.html")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a scenario, its config and a campaign."""
    (tmp_path / "water.json5").write_text(SCENARIO, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(FLEET, encoding="utf-8")
    (tmp_path / "campaign.json5").write_text(CAMPAIGN, encoding="utf-8")
    return tmp_path


class Cluster:
    """A dask scheduler and its workers, each in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "scheduler.json"
        self.workers: list[subprocess.Popen[bytes]] = []
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")
        self._scheduler = self._start("scheduler", *options)
        while not self._file.exists() or not self._file.read_text():
            assert self._scheduler.poll() is None
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._scheduler.wait(0.05)
        self.address: str = json.loads(self._file.read_text())["address"]

    def work(self) -> None:
        """Start a worker, which nobody starts again."""
        words = ("worker", "--no-nanny", "--nthreads", "1", "--no-dashboard")
        self.workers.append(self._start(*words))

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--scheduler-file", str(self._file)],
            cwd=self._file.parent, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def close(self) -> None:
        """End all of them."""
        for process in (*self.workers, self._scheduler):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler with two workers."""
    made = Cluster(tmp_path_factory.mktemp("dask"))
    try:
        made.work()
        made.work()
        yield made
    finally:
        made.close()


def campaign(folder: Path, cluster: Cluster, *words: str) -> int:
    return main(
        ["sim", "campaign", str(folder / "campaign.json5"), "--scheduler", cluster.address, *words]
    )


def table_in(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_workers_and_campaigns_that_are_killed_lose_nothing(
    folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    """Undisturbed; with a worker killed; and killed itself: the same bytes."""
    assert campaign(folder, cluster, "--output", str(folder / "calm"), "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["runs"], told["ran"], len(told["cells"])) == (RUNS, RUNS, 8)
    calm = [
        (folder / "calm" / name).read_bytes() for name in ("runs.csv", "cells.csv", "page.html")
    ]

    disturbed = folder / "disturbed"
    with started(folder, disturbed, "--scheduler", cluster.address) as process:
        wait_for_rows(disturbed, process, 6)
        cluster.workers[0].send_signal(signal.SIGKILL)
        assert process.wait(120) == 0
    assert cluster.workers[0].wait() == -signal.SIGKILL
    assert cluster.workers[1].poll() is None
    cluster.work()
    assert [(disturbed / name).read_bytes() for name in NAMES] == calm

    resumed = folder / "resumed"
    with started(folder, resumed, "--scheduler", cluster.address) as process:
        wait_for_rows(resumed, process, 6)
        process.send_signal(signal.SIGKILL)
        process.wait(60)
    done = lines_in(resumed)
    assert 6 <= done < RUNS
    with (resumed / "runs.jsonl").open("ab") as file:
        file.write(b'{"run":5,"figures":{"deliv')  # what a crash may leave of a line
    assert campaign(folder, cluster, "--output", str(resumed), "--json") == 0
    assert json.loads(capsys.readouterr().out)["ran"] == RUNS - done
    assert [(resumed / name).read_bytes() for name in NAMES] == calm


@contextlib.contextmanager
def started(folder: Path, output: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """The campaign in a process of its own."""
    command = [sys.executable, "-m", "zacoustic", "sim", "campaign", "campaign.json5"]
    process = subprocess.Popen(
        [*command, "--output", str(output), *words], cwd=folder, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def lines_in(output: Path) -> int:
    """How many rows are on the disk, without the first line."""
    path = output / "runs.jsonl"
    return path.read_bytes().count(b"\n") - 1 if path.exists() else 0


def wait_for_rows(output: Path, process: subprocess.Popen[bytes], rows: int) -> None:
    while lines_in(output) < rows:
        assert process.poll() is None, process.communicate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.02)


def test_a_row_is_what_the_run_alone_comes_to(
    folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign(folder, cluster) == 0
    rows = table_in(folder / "campaign.results" / "runs.csv")
    assert [(row["cell"], row["seed"]) for row in rows] == [
        (str(cell), str(seed)) for cell in range(8) for seed in range(1, 5)
    ]
    (folder / "fleet.json5").write_text(FLEET.replace("id: 1,", 'id: 1, codec: "packed",'))
    (folder / "water.json5").write_text(
        SCENARIO.replace("{ config", "{ loss: { frame: 0.3 }, config").replace("1000", "2000")
    )
    capsys.readouterr()
    words = ["sim", str(folder / "water.json5"), "--until", "300", "--seed", "3", "--json"]
    assert main(words) == 0
    alone = json.loads(capsys.readouterr().out)
    (row,) = [
        row for row in rows
        if (row["loss"], row["codec"], row["fleet"], row["seed"]) == ("0.3", "packed", "far", "3")
    ]  # fmt: skip
    assert row["digest"] == alone["digest"]
    assert int(row["frames"]) == alone["frames"]
    assert float(row["p95_s"]) == alone["p95_s"]
    nav = alone["streams"][0]
    assert float(row["nav: delivery"]) == nav["delivered"] / nav["expected"]
    assert len({each["digest"] for each in rows}) == RUNS


def test_cells_have_intervals_and_a_page_with_plots(
    folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign(folder, cluster, "--parquet") == 0
    shown = capsys.readouterr()
    assert "±" in shown.out
    assert f"{RUNS} of {RUNS} runs done" in shown.err
    output = folder / "campaign.results"
    assert campaign(folder, cluster) == 0  # nothing is missing: the same rows, as CSV
    assert "32 runs, 0 of them now" in capsys.readouterr().out

    from pyarrow import parquet

    table = parquet.read_table(output / "cells.parquet").to_pylist()
    as_text = table_in(output / "cells.csv")
    assert len(table) == len(as_text) == 8
    for cell, text in zip(table, as_text, strict=True):
        runs = [
            float(row["delivery"])
            for row in table_in(output / "runs.csv")
            if row["cell"] == text["cell"]
        ]
        mean = sum(runs) / 4
        spread = (sum((each - mean) ** 2 for each in runs) / 3 / 4) ** 0.5
        assert cell["delivery"] == float(text["delivery"]) == pytest.approx(mean)
        assert cell["delivery high"] == pytest.approx(mean + 3.182446 * spread)  # of three degrees
        assert cell["delivery count"] == 4
    page = (output / "page.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2 * 2  # two figures for each case of the third parameter
    assert "nav: p95_s" in page


def test_tracks_are_swept_as_files(
    folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, x in (("near", 300), ("far", 1500)):
        (folder / f"{name}.csv").write_text(f"t,x,y,z\n0,{x},0,20\n60,{x},50,20\n")
    (folder / "water.json5").write_text(
        SCENARIO.replace("position: [1000, 0, 50]", 'track: "near.csv"')
    )
    (folder / "campaign.json5").write_text(
        """{ scenario: "water.json5", until_s: 120, seeds: 1,
             sweep: [ { key: "nodes[1].track", values: ["near.csv", "far.csv"] } ] }"""
    )
    assert campaign(folder, cluster) == 0
    near, far = table_in(folder / "campaign.results" / "runs.csv")
    assert float(near["nav: mean_s"]) < float(far["nav: mean_s"])
    capsys.readouterr()
    (folder / "far.csv").write_text("t,x,y,z\n0,1501,0,20\n")
    assert campaign(folder, cluster) == 2
    assert "changed since then: a file that is named;" in capsys.readouterr().err


def test_a_changed_campaign_is_refused_and_nothing_is_lost(
    folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    small = CAMPAIGN.replace("[0, 0.3]", "[0]").replace("seeds: 4", "seeds: [7]")
    (folder / "campaign.json5").write_text(small)
    assert campaign(folder, cluster) == 0
    rows = (folder / "campaign.results" / "runs.jsonl").read_bytes()
    capsys.readouterr()

    def refused(what: str) -> None:
        assert campaign(folder, cluster) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert f"changed since then: {what}; allowed: the same campaign" in error
        assert "--output FOLDER" in error
        assert (folder / "campaign.results" / "runs.jsonl").read_bytes() == rows

    (folder / "campaign.json5").write_text(small.replace("300", "301"))
    refused("until_s")
    (folder / "campaign.json5").write_text(small.replace("[7]", "[7, 8]").replace("2000", "9"))
    refused("seeds, sweep")
    (folder / "campaign.json5").write_text(small)
    (folder / "water.json5").write_text(SCENARIO.replace("800", "801"))
    refused("the scenario")
    (folder / "water.json5").write_text(SCENARIO)
    (folder / "fleet.json5").write_text(FLEET.replace("float32", "float64"))
    refused("the config")
    (folder / "fleet.json5").write_text(FLEET)
    # What is shown may change, and so may comments and the place of all of it.
    (folder / "campaign.json5").write_text("// new\n" + small.replace('"delivery", ', ""))
    assert campaign(folder, cluster, "--json") == 0
    assert json.loads(capsys.readouterr().out)["ran"] == 0


@pytest.mark.parametrize(
    ("written", "instead", "expected"),
    [
        ("seeds: 4", "seeds: 0", "seeds is 0; allowed: a number, 1 to 100000"),
        ("seeds: 4", "seeds: [1, 1]", "seeds is with one of them twice"),
        ("until_s", "until", "until is no key; allowed: scenario, sweep, seeds, until_s"),
        ('"water.json5"', '"no.json5"', "no.json5"),
        ('"loss.frame"', '"loss..frame"', 'sweep[0].key is "loss..frame"; allowed: a path such'),
        ('"loss.frame"', '"los.frame"', "los is no key; allowed: nodes, seed"),
        ("[0, 0.3]", "[0, 3]", "loss = 3, codec = cbor, fleet = three: loss.frame is 3"),
        ("[0, 0.3]", "[]", "sweep[0].values is empty; allowed: at least one value"),
        ("nodes[1]", "nodes[7]", "nodes[7] is not there; allowed: [0] to [2], or [*]"),
        ("nodes[1].position[0]", "nodes.count", "nodes.count is 2000; allowed: 1 to 3"),
        ("streams[0]", "streams[2]", "streams[2] is not there; allowed: [0] to [1]"),
        ('"packed"', '"thin"', "fleet.json5 with loss = 0, codec = thin"),
        ('name: "codec"', 'name: "loss"', 'sweep is [… "loss" …] twice'),
        ('name: "codec"', 'name: "delivery"', 'sweep has the name "delivery"; allowed: none of'),
        ('"nav: p95_s"', '"nav: p96_s"', 'figures[1] is "nav: p96_s"; allowed: published'),
        ('key: "loss.frame"', 'key: "seed"', "since seeds says the seeds"),
        ("scenario:", "nodes: [], scenario:", "it looks like a scenario; a campaign names one"),
    ],
)
def test_a_wrong_campaign_is_one_line_and_makes_nothing(
    written: str, instead: str, expected: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert written in CAMPAIGN
    (folder / "campaign.json5").write_text(CAMPAIGN.replace(written, instead), encoding="utf-8")
    before = sorted(folder.iterdir())
    assert main(["sim", "campaign", str(folder / "campaign.json5")]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--workers", "0"], "--workers 0; allowed: 1..1024"),
        (["--timeout", "nan"], "--timeout nan; allowed: above 0"),
        (["--scheduler", "harbour"], "--scheduler harbour; allowed: tcp://HOST:PORT"),
        (["--output", "/dev/null"], "/dev/null"),
        (["--output", "."], "has files and no runs.jsonl; allowed: a new folder"),
    ],
)
def test_a_wrong_argument_is_one_line(
    words: list[str], expected: str, folder: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    assert main(["sim", "campaign", "campaign.json5", *words]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


def test_a_file_that_is_not_ours_stays_as_it_is(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = folder / "campaign.results"
    output.mkdir()
    for content in (b"1,2\n3,4\n", b"1,2", b'{"run": 1}\n'):
        (output / "runs.jsonl").write_bytes(content)
        assert main(["sim", "campaign", str(folder / "campaign.json5")]) == 2
        assert "is no file of rows" in capsys.readouterr().err
        assert (output / "runs.jsonl").read_bytes() == content


def test_nobody_at_the_scheduler_takes_its_time(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--timeout", "0.5", "--scheduler", "tcp://127.0.0.1:1"]
    assert main(["sim", "campaign", str(folder / "campaign.json5"), *words]) == 3
    assert "no scheduler at tcp://127.0.0.1:1 within 0.5 s" in capsys.readouterr().err


def test_no_worker_a_scheduler_that_dies_and_one_process_at_a_time(
    folder: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    mortal = Cluster(tmp_path_factory.mktemp("mortal"))
    output = folder / "campaign.results"
    try:
        assert campaign(folder, mortal, "--timeout", "0.5") == 3
        assert "no worker within 0.5 s; start one: dask worker" in capsys.readouterr().err
        mortal.work()
        with started(folder, output, "--scheduler", mortal.address) as process:
            wait_for_rows(output, process, 1)
            assert campaign(folder, mortal) == 2
            assert "runs.jsonl is in use; allowed: one process" in capsys.readouterr().err
            mortal.close()
            assert process.wait(60) == 1
            assert process.stderr is not None
            *progress, last = process.stderr.read().decode().splitlines()
    finally:
        mortal.close()
    assert last.startswith("zacoustic sim campaign: the scheduler is gone (start it again to go on")
    assert all(line.endswith("runs done") for line in progress)
    assert lines_in(output) >= 1


@pytest.fixture
def thawed() -> Iterator[None]:
    """A worker freezes what it has loaded; this process is none."""
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("thawed")
def test_a_worker_refuses_another_version_and_other_files(folder: Path) -> None:
    path = folder / "campaign.json5"
    asked = campaign_of(read_spec(path), path, version())
    answered = msgspec.json.decode(run_batch(msgspec.json.encode(asked), [0, 9]), type=Batch)
    assert [row.run for row in answered.rows] == [0, 9]
    other = msgspec.structs.replace(asked, version="0.0.0")
    answered = msgspec.json.decode(run_batch(msgspec.json.encode(other), [0, 9]), type=Batch)
    assert answered.rows == []
    assert answered.failure is not None
    assert "the campaign is of 0.0.0" in answered.failure.reason
    other = msgspec.structs.replace(asked, files={"fleet.json5": "00"})
    answered = msgspec.json.decode(run_batch(msgspec.json.encode(other), [0, 9]), type=Batch)
    assert answered.failure is not None
    assert "fleet.json5 is not the file that the campaign was started with" in (
        answered.failure.reason
    )


def test_what_fails_in_a_worker_names_its_run(
    folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    """The traffic is checked where it runs; what was done before is kept, and the cure is known."""
    changed = CAMPAIGN.replace("nodes[1].position[0]", "traffic[0].topic").replace("2000", '"n"')
    (folder / "campaign.json5").write_text(changed, encoding="utf-8")
    assert campaign(folder, cluster) == 2
    error = capsys.readouterr().err
    assert 'fleet = far: traffic[0].topic: "n"; allowed: nav, raw' in error
    assert error.count("\n") == 1


def test_the_campaign_of_the_examples(
    tmp_path: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    examples = Path(__file__).parents[2] / "examples"
    for name in ("11_campaign.json5", "11_water.json5"):
        text = (examples / name).read_text(encoding="utf-8")
        text = text.replace("until_s: 1800", "until_s: 120").replace("seeds: 5", "seeds: 1")
        (tmp_path / name).write_text(text, encoding="utf-8")
    path = tmp_path / "11_campaign.json5"
    assert main(["sim", "campaign", str(path), "--scheduler", cluster.address, "--json"]) == 0
    cells = json.loads(capsys.readouterr().out)["cells"]
    assert len(cells) == 24
    published = {
        cell["parameters"]["nodes"]: cell["figures"]["published"]["mean"]
        for cell in cells
        if cell["parameters"]["period, s"] == 15 and cell["parameters"]["loss"] == 0
    }
    assert published[2] < published[4] < published[8]


def test_workers_of_this_computer(folder: Path) -> None:
    """The whole way, as a user types it; with no terminal, a line for each tenth."""
    small = CAMPAIGN.replace("[0, 0.3]", "[0]").replace("seeds: 4", "seeds: 1")
    (folder / "campaign.json5").write_text(small)
    command = [sys.executable, "-m", "zacoustic", "sim", "campaign", "campaign.json5"]
    process = subprocess.run(
        [*command, "--workers", "2", "--json"], cwd=folder, capture_output=True, text=True,
        timeout=120, check=False, env={**os.environ, "PYTHONHASHSEED": "3"},
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert json.loads(process.stdout)["ran"] == 4
    assert "4 of 4 runs done" in process.stderr
    assert "Traceback" not in process.stderr


def test_who_runs_one_scenario_imports_no_dask(folder: Path) -> None:
    program = (
        "import sys; from zacoustic.app.cli import main;"
        "code = main(['sim', 'water.json5', '--until', '60']);"
        "print(*(name in sys.modules for name in ('dask', 'distributed', 'matplotlib')));"
        "sys.exit(code)"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines()[-1] == "False False False"
