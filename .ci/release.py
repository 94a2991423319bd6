"""Build what an index gets, from a commit that is ready for it: `make release`.

The source distribution and the wheel go into `dist/`. Nothing is built, and the exit code is 1,
while something is missing; everything that is missing is printed. Nothing is uploaded.
"""

import re
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
PLACEHOLDER: Final = "zacoustic.example"
"""Stands for the public address until there is one."""
PUBLISHED: Final = (
    "pyproject.toml",
    "SECURITY.md",
    "examples/deploy/Containerfile",
    "examples/deploy/blueos/metadata.json",
    "examples/ros2/zacoustic_bringup/package.xml",
    "examples/ros2/zacoustic_bringup/setup.py",
    "mkdocs.yml",
)
"""Files whose addresses others will follow."""


def main() -> int:
    """Check, build, and say what was built."""
    tag = git("describe", "--tags", "--exact-match", "--match", "v*")
    found = missing(
        tag,
        git("status", "--porcelain"),
        {name: (ROOT / name).read_text("utf-8") for name in (*PUBLISHED, "CHANGELOG.md")},
    )
    for each in found:
        print(f"make release: {each}", file=sys.stderr)
    if found:
        return 1
    built = ROOT / "dist"
    return subprocess.run(
        [sys.executable, "-m", "build", "--outdir", str(built), str(ROOT)], check=False
    ).returncode


def missing(tag: str, changed: str, texts: dict[str, str]) -> list[str]:
    """Return what has to be done before the commit can be published.

    Args:
        tag: The tag of the commit, `v1.2.3`; empty if it has none.
        changed: What git says of files that differ from the commit; empty if none does.
        texts: The published files and CHANGELOG.md, by name.
    """
    found = []
    version = tag.removeprefix("v")
    if not re.fullmatch(r"\d+\.\d+\.\d+((a|b|rc)\d+)?", version):
        found.append(f"the commit has {tag or 'no tag'}; allowed: v1.2.3 (git tag v1.2.3)")
    elif not re.search(rf"^## \[{re.escape(version)}\] - ", texts["CHANGELOG.md"], re.MULTILINE):
        found.append(f"CHANGELOG.md has no section [{version}]: rename [Unreleased]")
    if changed:
        found.append(f"files differ from the commit:\n{changed}\ncommit or remove them")
    found.extend(
        f"{name} still has the placeholder {PLACEHOLDER}: write the public address in its place"
        for name in PUBLISHED
        if PLACEHOLDER in texts[name]
    )
    return found


def git(*arguments: str) -> str:
    """Return what git prints; empty where it fails or is not there."""
    try:
        process = subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        return ""
    return process.stdout.strip() if process.returncode == 0 else ""


if __name__ == "__main__":
    sys.exit(main())
