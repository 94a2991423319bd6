"""The container file of examples/deploy, whose rules are read off it: no engine is needed."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Final

import pytest

from tests.pages.blocks import ROOT
from zacoustic.app.cli import parse

FILE: Final = ROOT / "examples" / "deploy" / "Containerfile"

HADOLINT: Final = shutil.which("hadolint") or shutil.which(
    "hadolint", path=str(Path(sys.executable).parent)
)


def instructions() -> list[tuple[str, str]]:
    """The instructions of the file with their arguments, comments gone, continued lines joined."""
    lines = FILE.read_text(encoding="utf-8").splitlines(keepends=True)
    text = "".join(line for line in lines if not line.startswith("#"))
    joined = re.sub(r"\\\n\s*", "", text)
    split = (line.partition(" ") for line in joined.splitlines() if line.strip())
    return [(name, arguments.strip()) for name, _, arguments in split]


def last_stage() -> list[tuple[str, str]]:
    """The instructions behind the last FROM: what ends in the image."""
    every = instructions()
    start = max(number for number, (name, _) in enumerate(every) if name == "FROM")
    return every[start:]


def last(name: str) -> str:
    """The arguments of an instruction in the last stage; of several the last counts."""
    return [arguments for each, arguments in last_stage() if each == name][-1]


def test_every_base_is_pinned_to_a_python_and_a_debian_for_any_machine() -> None:
    bases = [arguments.split(" AS ")[0] for name, arguments in instructions() if name == "FROM"]
    assert len(bases) == 2
    for base in bases:
        assert re.fullmatch(r"docker\.io/library/python:3\.\d+-slim-[a-z]+", base), base
    assert len(set(bases)) == 1  # the environment of one stage runs in the other
    assert not re.search(r"amd64|x86_64|arm64|aarch64", " ".join(map(" ".join, instructions())))


def test_it_does_not_run_as_root() -> None:
    assert int(last("USER")) > 0
    after = [name for name, _ in last_stage()]
    assert "RUN" not in after[after.index("USER") :]
    assert f"--uid {last('USER')} " in last("RUN")


def test_it_starts_a_gateway_whose_journal_is_on_the_volume() -> None:
    entry, command = json.loads(last("ENTRYPOINT")), json.loads(last("CMD"))
    assert entry == ["zacoustic"]
    verb, arguments = parse(command)
    assert verb.name == "gateway"
    (volume,) = json.loads(last("VOLUME"))
    assert Path(arguments.journal).is_relative_to(volume)


def test_its_health_is_what_a_command_of_ours_finds() -> None:
    """`topic list` asks the gateway over Zenoh: exit code 0 only while one answers (tests/cli)."""
    _, _, command = last("HEALTHCHECK").partition("CMD ")
    *shell, script = json.loads(command)
    assert shell == ["/bin/sh", "-c"]
    program, *arguments = shlex.split(script.removesuffix(" || exit 1"))
    assert program == "zacoustic"
    verb, parsed = parse(arguments)
    assert verb.name == "list"
    assert parsed.config == json.loads(last("CMD"))[2]


def test_what_it_copies_is_there_and_no_pattern_keeps_it_out() -> None:
    copied = [
        source
        for name, arguments in instructions()
        if name == "COPY" and not arguments.startswith("--from=")
        for source in shlex.split(arguments)[:-1]
    ]
    assert {".ci", "pyproject.toml", "README.md", "LICENSE", "zacoustic", "links"} == {*copied}
    for source in copied:
        assert (ROOT / source).exists(), source
        assert not is_ignored(source), source
    assert is_ignored(".git")
    assert is_ignored(".venv")
    assert is_ignored("zacoustic/core/__pycache__")


def is_ignored(path: str) -> bool:
    """Whether .dockerignore keeps a path out: its last pattern that fits decides."""
    ignored = False
    for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines():
        pattern = line.removeprefix("!").removeprefix("**/")
        if line and not line.startswith("#"):
            parts = path.split("/")
            fits = fnmatch(path.rpartition("/")[2] if "**/" in line else parts[0], pattern)
            ignored = not line.startswith("!") if fits else ignored
    return ignored


def test_it_installs_extras_that_are_there() -> None:
    (extras,) = (
        arguments.partition("=")[2].strip('"').split(",")
        for name, arguments in instructions()
        if name == "ARG" and arguments.startswith("EXTRAS=")
    )
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for extra in extras:
        assert re.search(rf"^{extra} = \[", project, re.MULTILINE), extra


def labels() -> dict[str, str]:
    """The labels, without their quotes."""
    pairs = (arguments.partition("=") for name, arguments in last_stage() if name == "LABEL")
    return {key: text[1:-1] for key, _, text in pairs}


def test_its_labels_are_those_of_an_extension_of_blueos() -> None:
    given = labels()
    assert {"version", "permissions", "authors", "company", "readme", "links", "type", "tags"} <= {
        *given
    }
    assert given["type"] in ("device-integration", "example", "tool", "other")
    tags = json.loads(given["tags"])
    assert 0 < len(tags) <= 10
    assert all(re.fullmatch(r"[a-z0-9-]+", tag) for tag in tags)
    assert {"name", "email"} <= {*json.loads(given["authors"])[0]}
    assert {"name", "email", "about"} <= {*json.loads(given["company"])}
    assert {"website", "support", "documentation"} <= {*json.loads(given["links"])}


def test_blueos_gives_it_the_network_serial_ports_and_a_place_for_its_state() -> None:
    host: dict[str, Any] = json.loads(labels()["permissions"])["HostConfig"]
    assert host["NetworkMode"] == "host"
    assert "Privileged" not in host
    inside = {bind.split(":")[1] for bind in host["Binds"]}
    assert inside == {"/etc/zacoustic", json.loads(last("VOLUME"))[0], "/dev"}
    assert {"c 188:* rw", "c 166:* rw"} <= {*host["DeviceCgroupRules"]}
    assert host["GroupAdd"] == ["dialout"]


def test_the_entry_of_blueos_catalogue_has_its_four_keys() -> None:
    path = FILE.parent / "blueos" / "metadata.json"
    entry = json.loads(path.read_text(encoding="utf-8"))
    assert {*entry} == {"name", "website", "docker", "description"}
    assert entry["website"] == json.loads(labels()["links"])["website"]


@pytest.mark.skipif(HADOLINT is None, reason="hadolint is not installed: make hadolint")
def test_hadolint_finds_nothing() -> None:
    assert HADOLINT is not None
    process = subprocess.run([HADOLINT, FILE], capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout
