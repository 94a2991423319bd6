"""What a host of the repository reads: workflow, issue forms, changelog; and a release's checks."""

import datetime
import importlib.util
import re
import shlex
from argparse import Namespace
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest
from ruamel.yaml import YAML

from tests.pages.blocks import ROOT
from zacoustic.app.cli import parse

FORMS: Final = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
KINDS: Final = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]
"""The headings of Keep a Changelog, in its order."""

_VERSION: Final = re.compile(r"## \[(\d+)\.(\d+)\.(\d+)\] - (\d{4}-\d\d-\d\d)")


def load(path: Path) -> Any:
    return YAML(typ="safe").load(StringIO(path.read_text(encoding="utf-8")))


def targets() -> set[str]:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z][\w-]*):", makefile, re.MULTILINE))


def test_every_command_of_the_workflow_is_a_target_of_the_makefile() -> None:
    jobs = load(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]
    commands = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    words = [shlex.split(line) for command in commands for line in command.splitlines()]
    assert [command[0] for command in words] == ["make"] * len(words)
    named = {target for command in words for target in command[1:]}
    assert named <= targets()
    assert named >= {"format", "lint", "types", "contracts", "unit", "package", "container"}
    assert named >= {"docs", "tutorial", "frictions", "test-browser", "hadolint"}


def test_the_workflow_runs_every_python_that_the_metadata_names() -> None:
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    named = re.findall(r"Programming Language :: Python :: (3\.\d+)", project)
    jobs = load(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]
    assert jobs["tests"]["strategy"]["matrix"]["python"] == named


def test_every_target_is_declared_as_no_file() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = set(" ".join(re.findall(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)).split())
    assert targets() == phony


@pytest.mark.parametrize("path", [form for form in FORMS if form.stem != "config"], ids=str)
def test_an_issue_form_is_one_and_asks_for_the_doctors_report(path: Path) -> None:
    form = load(path)
    assert {"name", "description", "body"} <= set(form)
    fields = [field for field in form["body"] if field["type"] != "markdown"]
    assert {field["type"] for field in fields} <= {"textarea", "input", "dropdown", "checkboxes"}
    names = [field["id"] for field in fields]
    assert len(set(names)) == len(names)
    assert all(field["attributes"]["label"] for field in fields)
    (doctor,) = (field for field in fields if field["id"] == "doctor")
    (command,) = re.findall(r"`zacoustic (.*?)`", doctor["attributes"]["description"])
    verb, arguments = parse(shlex.split(command))
    assert verb.name == "doctor"
    assert arguments.json


def test_the_changelog_has_the_form_of_keep_a_changelog() -> None:
    assert faults_of((ROOT / "CHANGELOG.md").read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("# Changelog\n## [1.0.0] - 2026-01-31\n### Added\n- a\n", "no section [Unreleased] first"),
        ("# News\n## [Unreleased]\n", "the title is not # Changelog"),
        ("# Changelog\n## [Unreleased]\n### New\n- a\n", "[Unreleased]: headings New"),
        (
            "# Changelog\n## [Unreleased]\n### Fixed\n- a\n### Added\n- b\n",
            "[Unreleased]: headings Fixed, Added",
        ),
        ("# Changelog\n## [Unreleased]\n### Added\n", "[Unreleased]: nothing under Added"),
        ("# Changelog\n## [Unreleased]\n## 1.0.0\n", "no version and date: ## 1.0.0"),
        (
            "# Changelog\n## [Unreleased]\n## [1.0.0] - 2026-01-31\n## [1.1.0] - 2026-02-01\n",
            "versions do not fall",
        ),
        ("# Changelog\n## [Unreleased]\n## [1.0.0] - 2026-02-31\n", "no day: 2026-02-31"),
    ],
)
def test_a_changelog_of_another_form_is_found(text: str, fault: str) -> None:
    assert faults_of(text) == [fault]


def faults_of(text: str) -> list[str]:
    """Say what in a changelog differs from the form."""
    head, *sections = re.split(r"^(?=## )", text, flags=re.MULTILINE)
    found = [] if head.startswith("# Changelog\n") else ["the title is not # Changelog"]
    titles = [section.splitlines()[0] for section in sections]
    if titles[:1] != ["## [Unreleased]"]:
        found.append("no section [Unreleased] first")
    versions = []
    for title in titles:
        if (parsed := _VERSION.fullmatch(title)) is not None:
            versions.append(tuple(map(int, parsed.groups()[:3])))
            try:
                datetime.date.fromisoformat(parsed[4])
            except ValueError:
                found.append(f"no day: {parsed[4]}")
        elif title != "## [Unreleased]":
            found.append(f"no version and date: {title}")
    if versions != sorted(set(versions), reverse=True):
        found.append("versions do not fall")
    for title, section in zip(titles, sections, strict=True):
        parts = re.split(r"^### (.*)\n", section, flags=re.MULTILINE)
        kinds, texts = parts[1::2], parts[2::2]
        name = title.removeprefix("## ")
        if kinds != [kind for kind in KINDS if kind in kinds]:
            found.append(f"{name}: headings {', '.join(kinds)}")
        found.extend(
            f"{name}: nothing under {kind}"
            for kind, below in zip(kinds, texts, strict=True)
            if not re.search(r"^- ", below, re.MULTILINE)
        )
    return found


def test_a_release_is_refused_while_something_is_missing() -> None:
    release = script("release")
    missing = release.missing
    ready = {
        "CHANGELOG.md": "# Changelog\n\n## [Unreleased]\n\n## [1.2.3] - 2026-01-31\n",
        **dict.fromkeys(release.PUBLISHED, ""),
    }
    assert missing("v1.2.3", "", ready) == []
    (tagless,) = missing("", "", ready)
    assert "no tag" in tagless
    (unnamed,) = missing("v1.2.4", "", ready)
    assert "no section [1.2.4]" in unnamed
    (changed,) = missing("v1.2.3", " M README.md", ready)
    assert "README.md" in changed
    (placeholder,) = missing("v1.2.3", "", {**ready, "SECURITY.md": "x@zacoustic.example"})
    assert placeholder.startswith("SECURITY.md")


def test_a_release_looks_at_every_file_that_has_the_placeholder() -> None:
    release = script("release")
    having = {
        path.relative_to(ROOT).as_posix()
        for folder in (".", ".github", "docs", "examples", "links", "zacoustic")
        for path in (ROOT.glob("*") if folder == "." else (ROOT / folder).rglob("*"))
        if path.is_file() and release.PLACEHOLDER.encode() in path.read_bytes()
    }
    assert having - {"CONTRIBUTING.md"} <= {*release.PUBLISHED}


def test_a_bundle_for_another_computer_names_it_and_every_older_c_library() -> None:
    target_of = script("bundle").target_of
    assert target_of(Namespace(glibc=None, machine="x86_64", python="3.12")) == []
    words = target_of(Namespace(glibc="2.19", machine="aarch64", python="3.12"))
    assert words[1:8:2] == [
        "manylinux_2_19_aarch64",
        "manylinux_2_18_aarch64",
        "manylinux_2_17_aarch64",
        "manylinux2014_aarch64",
    ]
    assert words[8:10] == ["--python-version", "3.12"]


def script(name: str) -> ModuleType:
    """Load a script of .ci/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
