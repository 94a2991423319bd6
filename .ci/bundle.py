"""Put the project and all that it needs into a folder, for a ship without internet: `make bundle`.

The folder has the wheels, their check sums and `install.sh`, which needs neither an index nor pip
nor ensurepip on the ship, only a Python of the version that the bundle is made for. By default that
is the Python and the computer that run this; a Raspberry Pi with Debian 12::

    make bundle ARGS='--machine aarch64 --glibc 2.36 --python 3.11'

Making a bundle needs a package index. It is made aside, and takes the place of an older one only
when it is whole. A folder that is no bundle is never replaced.
"""

import argparse
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]

OLDEST_GLIBC: Final = 17
"""Wheels for still older C libraries are rare."""

INSTALL: Final = """\
#!/bin/sh
# Install zacoustic {version} from this folder alone, for Python {python} on {machine}:
#
#   sh install.sh [FOLDER]      into a virtual environment, /opt/zacoustic by default
#
# PYTHON=/path/to/python{python} takes that one. An older installation in the folder is upgraded.
set -eu

target=${{1:-/opt/zacoustic}}
here=$(cd "$(dirname "$0")" && pwd)

fail() {{ echo "install.sh: $*" >&2; exit 1; }}
fits() {{
    "$1" -c 'import platform, sys
sys.exit("%d.%d" % sys.version_info[:2] != "{python}" or platform.machine() != "{machine}")' \\
        </dev/null >/dev/null 2>&1
}}

case $target in
-h | --help) echo "usage: sh install.sh [FOLDER]"; exit ;;
-*) echo "usage: sh install.sh [FOLDER]" >&2; exit 2 ;;
esac
candidates=${{PYTHON:-python{python} python3 python}}
python=
for candidate in $candidates; do
    if fits "$candidate"; then python=$candidate; break; fi
done
[ -n "$python" ] || fail "no Python {python} on {machine} here (tried $candidates), and this" \\
    "bundle is for that: name one (PYTHON=/path/to/python{python}), or make another bundle"

if command -v sha256sum >/dev/null; then
    (cd "$here" && sha256sum --quiet --check SHA256SUMS) ||
        fail "files are damaged or missing: copy the folder again"
fi
"$python" -m venv --without-pip "$target" ||
    fail "cannot write $target: name a folder that you may write, sh install.sh FOLDER"
set -- "$here"/wheels/pip-*.whl
"$target/bin/python" "$1/pip" install --quiet --disable-pip-version-check --isolated \\
    --no-index --find-links "$here/wheels" --upgrade "{requirement}"
"$target/bin/zacoustic" --version
"""


def main() -> None:
    """Gather the wheels, write the installer, and say where they are."""
    given = arguments()
    output: Path = given.output
    output.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".bundle-", dir=output.parent) as aside:
        made = Path(aside, "made")
        count = gather(made, given)
        made.chmod(0o755)
        if output.exists():
            output.rename(Path(aside, "older"))
        made.rename(output)
    print(f"{output}: {count} wheels; on the ship: sh install.sh")


def gather(folder: Path, given: argparse.Namespace) -> int:
    """Make the bundle in a new folder; returns how many wheels it has."""
    wheels = folder / "wheels"
    wheels.mkdir(parents=True)
    if given.wheel is not None:
        shutil.copy(given.wheel, wheels)
    else:
        pip("wheel", "--no-deps", "--wheel-dir", wheels, ROOT)
    (own,) = wheels.glob("zacoustic-*.whl")
    extras = f"[{given.extras}]" if given.extras else ""
    pip(
        "download", "--only-binary", ":all:", "--dest", wheels, *target_of(given),
        f"{own}{extras}", "pip",
    )  # fmt: skip
    version = own.name.split("-")[1]
    text = INSTALL.format(
        version=version,
        python=given.python,
        machine=given.machine,
        requirement=f"zacoustic{extras}=={version}",
    )
    (folder / "install.sh").write_text(text, encoding="utf-8")
    (folder / "SHA256SUMS").write_text(sums(folder), encoding="utf-8")
    return len([*wheels.iterdir()])


def arguments() -> argparse.Namespace:
    """Read the arguments."""
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    machine = platform.machine()
    parser = argparse.ArgumentParser(
        prog="make bundle",
        description="Put the project and all that it needs into a folder.",
        epilog="example, a Raspberry Pi with Debian 12: make bundle "
        "ARGS='--machine aarch64 --glibc 2.36 --python 3.11'",
    )
    parser.add_argument("--extras", default="gateway,ros", help="of the project (gateway,ros)")
    parser.add_argument(
        "--python", default=here, metavar="3.N", help=f"the ship's, python3 --version ({here})"
    )
    parser.add_argument("--machine", default=machine, help=f"the ship's, uname -m ({machine})")
    parser.add_argument(
        "--glibc", metavar="2.N", help="the ship's, ldd --version (as here; needed for another)"
    )
    parser.add_argument("--wheel", type=Path, help="of the project, in place of building it")
    parser.add_argument(
        "--output", type=absolute, default=ROOT / "dist" / "bundle", metavar="FOLDER",
        help="a new folder, or an older bundle, which it replaces (dist/bundle)",
    )  # fmt: skip
    given = parser.parse_args()
    if not re.fullmatch(r"3\.\d+", given.python):
        parser.error(f"--python is {given.python}; allowed: 3.11 or later, such as 3.12")
    if given.glibc is None and (given.python, given.machine) != (here, machine):
        parser.error("--python or --machine of another computer needs --glibc, such as 2.36")
    if given.glibc is not None and not re.fullmatch(r"2\.\d+", given.glibc):
        parser.error(f"--glibc is {given.glibc}; allowed: such as 2.36")
    known = known_extras()
    for name in filter(None, given.extras.split(",")):
        if name not in known:
            parser.error(f"--extras: {name}; allowed: {', '.join(known)}")
    if not may_be_replaced(given.output):
        parser.error(
            f"--output {given.output} is there and is no bundle; "
            "allowed: a new folder, an empty one, or an older bundle"
        )
    return given


def known_extras() -> list[str]:
    """Return the names of the extras that a user can ask for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return sorted(project["optional-dependencies"].keys() - {"test", "docs"})


def may_be_replaced(folder: Path) -> bool:
    """Tell whether a folder is absent, empty, or what this program has made and nothing else."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        return False
    found = {path.name for path in folder.iterdir()} if folder.exists() else set()
    return not found or found == {"install.sh", "SHA256SUMS", "wheels"}


def absolute(text: str) -> Path:
    """Return a path whose last part is a name: `.` has no parent to work in."""
    return Path(os.path.abspath(text))


def target_of(given: argparse.Namespace) -> list[str]:
    """Return pip's arguments for another computer; empty for this one.

    pip takes wheels of exactly the platforms that it is told; every older C library is one.
    """
    if given.glibc is None:
        return []
    newest = int(given.glibc.partition(".")[2])
    names = [f"manylinux_2_{number}" for number in range(newest, OLDEST_GLIBC - 1, -1)]
    tags = [
        word
        for name in (*names, "manylinux2014")
        for word in ("--platform", f"{name}_{given.machine}")
    ]
    return [*tags, "--python-version", given.python, "--implementation", "cp"]


def sums(folder: Path) -> str:
    """Return the check sums of the wheels, in the form of sha256sum."""
    return "".join(
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder).as_posix()}\n"
        for path in sorted((folder / "wheels").iterdir())
    )


def pip(*words: Path | str) -> None:
    """Run pip, which has to succeed."""
    command = [sys.executable, "-m", "pip", *map(str, words), "--quiet"]
    subprocess.run(command, check=True)


if __name__ == "__main__":
    try:
        main()
    except subprocess.CalledProcessError as error:  # pip has said why
        sys.exit(f"make bundle: pip {error.cmd[3]} failed; an older bundle is as it was")
    except OSError as error:
        sys.exit(f"make bundle: {error.filename}: {error.strerror}")
