"""Write the software bill of materials of an installation: `make sbom`.

What a vessel gets, the project with the extras `gateway` and `ros`, is installed into an
environment of its own, and the tool into another one, so that neither appears in the other.
`dist/zacoustic.cdx.json` (CycloneDX) then lists every package with its version, licence, source and
what needs it. It needs a package index.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
TOOL: Final = "cyclonedx-bom>=7,<8"


def main() -> None:
    """Install both, list, and say where the list is."""
    parser = argparse.ArgumentParser(prog="make sbom", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--extras", default="gateway,ros", help="of the project (gateway,ros)")
    parser.add_argument("--output", type=Path, default=ROOT / "dist" / "zacoustic.cdx.json")
    given = parser.parse_args()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        ship = installed(Path(folder) / "ship", f"{ROOT}[{given.extras}]")
        tool = installed(Path(folder) / "tool", TOOL)
        run(
            tool.with_name("cyclonedx-py"), "environment", ship,
            "--pyproject", ROOT / "pyproject.toml", "--mc-type", "application",
            "--output-reproducible", "--of", "JSON", "-o", given.output,
        )  # fmt: skip
        name_version(given.output, version_in(ship))
    print(given.output)


def name_version(path: Path, version: str) -> None:
    """Write the project's version into the list; the tool finds none, since it is a tag."""
    content = json.loads(path.read_text("utf-8"))
    content["metadata"]["component"]["version"] = version
    path.write_text(json.dumps(content, indent=2) + "\n", "utf-8")


def version_in(python: Path) -> str:
    """Return the version of the project that an environment has."""
    program = "from importlib.metadata import version; print(version('zacoustic'))"
    return subprocess.run(
        [str(python), "-c", program], check=True, capture_output=True, text=True
    ).stdout.strip()


def installed(folder: Path, requirement: str) -> Path:
    """Make an environment that holds a requirement and what it needs; return its Python."""
    venv.create(folder, symlinks=os.name != "nt")
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", requirement)
    return python


def run(*command: Path | str) -> None:
    """Run a command, which has to succeed."""
    subprocess.run([str(each) for each in command], check=True)


if __name__ == "__main__":
    main()
