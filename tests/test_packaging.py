"""The wheel, built from the source distribution and installed where nothing else is.

An editable install forgives what a wheel does not: a data file that is left out, a dependency that
is not declared.
"""

import ast
import json
import os
import re
import subprocess
import sys
import venv
import zipfile
from collections.abc import Callable
from email import message_from_string
from email.message import Message
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[1]
FOLDERS: Final = [ROOT / "zacoustic", *sorted((ROOT / "links").glob("zacoustic_*"))]
BARE: Final = ("msgspec", "cbor2")
"""All that `zacoustic.core` may need."""

IMPORT_CORE: Final = """
import importlib, pkgutil
import zacoustic.core

for module in pkgutil.walk_packages(zacoustic.core.__path__, "zacoustic.core."):
    importlib.import_module(module.name)
print(importlib.util.find_spec("zenoh"), importlib.util.find_spec("serial"))
"""
LARGEST_BYTES: Final = 1_700_000
MOST_PACKAGES: Final = 5
LONGEST_IMPORT_S: Final = 0.1
API: Final = ROOT / "tests" / "golden" / "public_api.txt"
EXPLAIN: Final = """
import importlib, inspect, sys, time
from pathlib import Path

sys.path[:0] = sys.argv[2:]
began = time.perf_counter()
import zacoustic
print(time.perf_counter() - began, file=sys.stderr)
assert zacoustic.__file__.startswith(sys.argv[2]), zacoustic.__file__
for name in Path(sys.argv[1]).read_text().split():
    module, _, last = name.rpartition(".")
    found = getattr(importlib.import_module(module), last)
    is_value = not callable(found) and not inspect.ismodule(found)
    print(name, type(found).__name__ if is_value else inspect.getdoc(found))
    for each in vars(found) if inspect.isclass(found) else ():
        if each[0] == "_":
            continue
        print(name, each, inspect.getdoc(getattr(found, each)))
from zacoustic.app.cli import main
main(["schema", "--markdown"])
main(["links"])
"""
LOAD_ENTRY_POINTS: Final = """
from importlib.metadata import distribution

for entry_point in distribution("zacoustic").entry_points:
    entry_point.load()
    print(entry_point.group, entry_point.name)
"""

pytestmark = pytest.mark.timeout(900)  # downloads


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, temporary = tmp_path_factory.mktemp("dist"), tmp_path_factory.mktemp("temporary")
    command = [sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)]
    run(*command, TMPDIR=str(temporary))
    assert [*temporary.glob("*")] == []
    return next(folder.glob("*.whl"))


def test_wheel_contains_every_file_of_the_packages(wheel: Path) -> None:
    expected = {
        path.relative_to(folder.parent).as_posix()
        for folder in FOLDERS
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
        if path.name != "py.typed" or path.parent in FOLDERS  # one for each package: PEP 561
    }
    with zipfile.ZipFile(wheel) as archive:
        contained = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert contained == expected


def test_wheel_is_small_and_needs_little(wheel: Path) -> None:
    assert wheel.stat().st_size <= LARGEST_BYTES
    assert len(requirements(wheel)) <= MOST_PACKAGES


def test_modules_of_the_wheel_are_those_of_the_checkout_line_by_line(
    wheel: Path, sized: Callable[..., int]
) -> None:
    """Some lack their docstrings (`.ci/lean.py`), and nothing moves."""
    places = [(folder.parent, path) for folder in FOLDERS for path in sorted(folder.rglob("*.py"))]
    with zipfile.ZipFile(wheel) as archive:
        for parent, path in places[:: sized(1, share=8)]:
            name = path.relative_to(parent).as_posix()
            assert bare(archive.read(name).decode()) == bare(path.read_text("utf-8")), name


def test_what_a_user_can_ask_the_wheel_is_what_the_checkout_answers(
    wheel: Path, tmp_path: Path
) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    answers = [
        subprocess.run(
            [sys.executable, "-c", EXPLAIN, str(API), *map(str, places)],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )
        for places in ([tmp_path], [ROOT, ROOT / "links"])
    ]  # fmt: skip
    assert answers[0].stdout == answers[1].stdout, answers[0].stderr
    assert len(answers[0].stdout) > 100_000
    assert min(map(float, answers[0].stderr.split())) <= LONGEST_IMPORT_S


def bare(source: str) -> list[str]:
    """Give the parts of a module with their lines, without texts that only explain."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [each for each in body if not explains(each)]  # type: ignore[attr-defined]
    return [
        f"{type(node).__name__} {getattr(node, 'lineno', 0)} {getattr(node, 'value', '')!r:.20}"
        if isinstance(node, ast.Constant)
        else f"{type(node).__name__} {getattr(node, 'lineno', 0)}"
        for node in ast.walk(tree)
    ]


def explains(node: ast.stmt) -> bool:
    """Tell whether a statement is a text, or the dots of a body that had nothing else."""
    value = node.value if isinstance(node, ast.Expr) else None
    return isinstance(value, ast.Constant) and (isinstance(value.value, str) or value.value is ...)


def test_wheel_contains_the_licence(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        assert any(name.endswith(".dist-info/licenses/LICENSE") for name in archive.namelist())


def test_the_page_of_the_index_has_whole_addresses_only(wheel: Path) -> None:
    page = str(metadata_of(wheel).get_payload())
    assert page.startswith("# zacoustic\n")
    targets = re.findall(r"\]\(([^)]*)\)", page)
    assert len(targets) > 20
    assert [target for target in targets if not target.startswith(("https://", "#"))] == []


def test_the_version_is_a_tag_or_counts_from_one(wheel: Path) -> None:
    version = metadata_of(wheel)["Version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+((a|b|rc)\d+)?(\.dev\d+)?(\+[\w.]+)?", version), version


def test_the_extra_all_has_every_package_of_the_others(wheel: Path) -> None:
    extras = metadata_of(wheel).get_all("Provides-Extra", [])
    assert {"all", "console", "gateway", "ros", "secure", "terminal"} <= {*extras}
    brought = {extra: packages_of(wheel, extra) for extra in extras}
    others = [packages for extra, packages in brought.items() if extra not in ("test", "docs")]
    assert brought["all"] == set().union(*others)


def test_core_imports_with_zenoh_and_pyserial_absent(wheel: Path, tmp_path: Path) -> None:
    python = make_environment(tmp_path)
    needed = [requirement for requirement in requirements(wheel) if requirement.startswith(BARE)]
    assert len(needed) == len(BARE)
    install(python, "--no-deps", str(wheel))
    install(python, *needed)
    assert run(str(python), "-c", IMPORT_CORE) == "None None\n"


def test_installed_wheel_offers_its_command_links_and_verbs(wheel: Path, tmp_path: Path) -> None:
    python = make_environment(tmp_path)
    install(python, str(wheel))
    loaded = run(str(python), "-c", LOAD_ENTRY_POINTS).splitlines()
    assert {"console_scripts zacoustic", "zacoustic.links sim", "zacoustic.commands medium"} <= {
        *loaded
    }
    assert "usage: zacoustic" in run(str(python.with_name("zacoustic")), "--help")


def test_what_the_pages_and_the_errors_advise_to_install_can_be_installed(
    tmp_path: Path, sized: Callable[..., int]
) -> None:
    """Typed in the checkout, into an empty environment; pip resolves all and writes nothing."""
    from tests.pages.test_installing import advised_packages

    ours = [each for each in advised_packages() if each.startswith(".")]
    assert {".", ".[all]", ".[gateway]"} <= {*ours}
    python = str(make_environment(tmp_path))
    into = ["-m", "pip", "--python", python, "install", "--dry-run", "--quiet"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    for what in ours[:: sized(1, share=7)]:
        process = subprocess.run(
            [sys.executable, *into, what], cwd=ROOT, env=environment, capture_output=True,
            text=True, check=False,
        )  # fmt: skip
        assert process.returncode == 0, (what, process.stderr)
        assert "does not provide the extra" not in process.stderr, (what, process.stderr)


@pytest.mark.skipif(os.name == "nt", reason="a script of sh")
def test_a_bundle_is_installed_from_its_folder_alone(wheel: Path, tmp_path: Path) -> None:
    disk = tmp_path / "a ship's disk"
    script = [str(ROOT / ".ci" / "bundle.py"), "--extras", "", "--output", str(disk)]
    run(sys.executable, *script, "--wheel", str(wheel))
    command = ["/bin/sh", str(disk / "install.sh"), str(tmp_path / "environment")]
    # No index, no PATH with a pip: a lonely Python.
    lonely = {"PYTHON": sys.executable, "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    lonely |= {"PIP_INDEX_URL": "http://127.0.0.1:9/"}
    version = metadata_of(wheel)["Version"]
    for _ in ("installed", "installed over it"):
        process = subprocess.run(command, env=lonely, capture_output=True, text=True, check=False)
        assert process.returncode == 0, process.stderr
        assert process.stdout == f"zacoustic {version}\n"
    links = run(str(tmp_path / "environment" / "bin" / "zacoustic"), "links", "--json")
    assert not any(link["error"] for link in json.loads(links)["links"])

    wrong = subprocess.run(
        command, env={**lonely, "PYTHON": "false"}, capture_output=True, text=True, check=False
    )
    assert wrong.returncode == 1
    assert "(tried false)" in wrong.stderr
    with next(disk.glob("wheels/msgspec-*.whl")).open("ab") as damaged:
        damaged.write(b"x")
    refused = subprocess.run(command, env=lonely, capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    assert "damaged" in refused.stderr


def test_a_bundle_replaces_nothing_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "history").mkdir()
    (tmp_path / "history" / "thesis.txt").write_text("years of work")
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "history")
    for where in (".", "history", "history/thesis.txt", "link"):
        done = bundle(tmp_path, "--output", where)
        assert done.returncode == 2, where
        assert "is no bundle; allowed: a new folder, an empty one, or" in done.stderr
    assert (tmp_path / "history" / "thesis.txt").read_text() == "years of work"


def test_an_unknown_extra_of_a_bundle_is_refused_by_its_name(tmp_path: Path) -> None:
    done = bundle(tmp_path, "--extras", "gateway,rosy", "--output", "new")
    assert done.returncode == 2
    assert "--extras: rosy; allowed: all, campaign, channel, " in done.stderr
    assert [*tmp_path.iterdir()] == []


def test_a_bundle_that_fails_leaves_the_older_one(tmp_path: Path) -> None:
    older = tmp_path / "older"
    (older / "wheels").mkdir(parents=True)
    for name in ("install.sh", "SHA256SUMS", "wheels/zacoustic-0.1.0-py3-none-any.whl"):
        (older / name).write_text("good")
    broken = tmp_path / "zacoustic-0.2.0-py3-none-any.whl"
    broken.write_text("no wheel")
    done = bundle(tmp_path, "--wheel", str(broken), "--output", "older")
    assert done.returncode == 1
    assert "an older bundle is as it was" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"older", broken.name}
    assert all(path.read_text() == "good" for path in older.rglob("*") if path.is_file())


def bundle(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Type `make bundle` in a folder; nobody answers as an index."""
    return subprocess.run(
        [sys.executable, str(ROOT / ".ci" / "bundle.py"), *arguments], cwd=folder,
        env={**os.environ, "PIP_INDEX_URL": "http://127.0.0.1:9/", "PIP_RETRIES": "0"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def requirements(wheel: Path) -> list[str]:
    """Give what the wheel says it needs, without its extras."""
    every = metadata_of(wheel).get_all("Requires-Dist", [])
    return [text for text in every if "extra ==" not in text]


def packages_of(wheel: Path, extra: str) -> set[str]:
    """Give the packages of others that an extra brings, by way of our other extras too."""
    found: set[str] = set()
    for text in metadata_of(wheel).get_all("Requires-Dist", []):
        requirement, _, marker = text.partition(";")
        if f"extra == '{extra}'" not in marker.replace('"', "'"):
            continue
        named = re.match(r"([\w.-]+)(?:\[(.*?)\])?", requirement)
        assert named is not None
        if named[1] == "zacoustic":
            found.update(*(packages_of(wheel, inner) for inner in named[2].split(",")))
        else:
            found.add(named[1])
    return found


def metadata_of(wheel: Path) -> Message:
    """Give what the wheel says of itself."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return message_from_string(archive.read(name).decode())


def make_environment(folder: Path) -> Path:
    """Make an empty environment and give its Python; no pip in it, so no ensurepip is needed."""
    environment = folder / "environment"
    venv.create(environment, symlinks=os.name != "nt")
    return environment / ("Scripts" if os.name == "nt" else "bin") / "python"


def install(python: Path, *arguments: str) -> None:
    run(sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", *arguments)


def run(*command: str, **environment: str) -> str:
    """Run a command away from the checkout, and give what it prints on standard output."""
    ours = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    process = subprocess.run(
        command,
        cwd=Path(command[0]).parent,
        env={**ours, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, f"{command}\n{process.stdout}\n{process.stderr}"
    return process.stdout
