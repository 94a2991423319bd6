"""Build the optional wheel whose engine and medium are compiled by mypyc: `make compiled`.

It has the names of the wheel of plain Python and makes the same bytes, faster:
`tests/benchmarks/bench_compiled.py` compares them over the runs of the oracle. It is for one
version of Python and one platform; to build it takes a C compiler and some ten minutes. Classes of
the compiled rooms take no new attributes, and programs cannot inherit from them.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Final

from packaging.tags import sys_tags

sys.path.insert(0, str(Path(__file__).parent))

from split import Module, read, split

ROOT: Final = Path(__file__).parents[2]
TOOLS: Final = ("build>=1.2", "mypy[mypyc]>=1.11", "wheel>=0.43")
ROOMS: Final = (
    "zacoustic/core",
    "zacoustic/channel",
)
"""What is compiled: where simulations spend their time."""
PLAIN: Final = (
    # Programs inherit from their classes.
    "zacoustic/channel/driver.py",
    "zacoustic/channel/modems.py",
    "zacoustic/core/engine/engine.py",
    "zacoustic/core/transport/contract.py",
    # A tap replaces methods of their objects: `zacoustic.core.engine.tap`.
    "zacoustic/core/engine/commands.py",
    "zacoustic/core/transport/commands/commands.py",
    "zacoustic/core/transport/keydelivery.py",
    "zacoustic/core/peers/ranging.py",
    "zacoustic/core/schedule/silence.py",
    "zacoustic/core/transport/routing.py",
    "zacoustic/core/transport/status.py",
    "zacoustic/core/peers/lostcontact.py",
    # mypyc cannot compile them.
    "zacoustic/core/profiles/profile.py",  # attributes that heirs give another type
    "zacoustic/core/profiles/native/protocols.py",
    "zacoustic/core/profiles/rmw_desert/protocols.py",
    "zacoustic/core/values/dense/text/examples.py",  # an heir of str with pattern matching
    "zacoustic/core/values/payload/packing.py",  # methods that heirs give another type
    "zacoustic/core/values/types/table.py",  # `in (*names, name)`
)
"""Files below the rooms that stay plain Python, and why."""
_SETUP: Final = """
from mypyc.build import mypycify
from setuptools import setup

files = open("files.txt", encoding="utf-8").read().split()
modules = mypycify(["--config-file", "mypy.ini", *files], opt_level="2", debug_level="0",
                   multi_file=True)
setup(name="zacoustic", ext_modules=modules)
"""
# The split has changed types that were checked before it.
_MYPY: Final = """[mypy]
explicit_package_bases = True
follow_imports = silent
ignore_errors = True
ignore_missing_imports = True
namespace_packages = True
"""


def main() -> int:
    """Build the wheel into a folder, and print its path."""
    parser = argparse.ArgumentParser(
        prog="make compiled", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--into", type=Path, default=ROOT / "dist", help="folder (dist)")
    into = parser.parse_args().into.absolute()
    into.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        tools = installed(Path(folder) / "tools", f"{ROOT}[secure]", *TOOLS)
        run(tools, "-m", "build", "--wheel", "--outdir", folder, ROOT)
        run(tools, "-m", "wheel", "unpack", "--dest", folder, *Path(folder).glob("*.whl"))
        tree = next(Path(folder).glob("zacoustic-*/"))
        compile_tree(tree, tools)
        run(tools, ROOT / "examples" / "16_action.py", cwd=tree, PYTHONPATH=str(tree))
        tag_as_compiled(next(tree.glob("*.dist-info")) / "WHEEL")
        run(tools, "-m", "wheel", "pack", "--dest-dir", into, tree)
    return 0


def compile_tree(tree: Path, tools: Path) -> None:
    """Compile the rooms of an unpacked wheel in their place.

    Args:
        tree: The folder with its packages.
        tools: A Python that has mypyc, and all that the packages import.
    """
    compiled = split(modules_in(tree))
    names = "\n".join(str(each.relative_to(tree)) for each in compiled)
    written = {"setup.py": _SETUP, "mypy.ini": _MYPY, "files.txt": names}
    for name, text in written.items():
        (tree / name).write_text(text, encoding="utf-8")
    run(tools, "setup.py", "-q", "build_ext", "--inplace", cwd=tree)
    for name in written:
        (tree / name).unlink()
    for folder in ("build", ".mypy_cache"):
        shutil.rmtree(tree / folder, ignore_errors=True)


def modules_in(tree: Path) -> list[Module]:
    """Return the modules of the rooms below a folder, without those that stay plain."""
    files = {file for room in ROOMS for file in (tree / room).rglob("*.py")}
    return read(tree, sorted(files - {tree / each for each in PLAIN}))


def tag_as_compiled(metadata: Path) -> None:
    """Name this Python and platform in the metadata of a wheel."""
    lines = metadata.read_text(encoding="utf-8").splitlines()
    kept = [each for each in lines if each and not each.startswith(("Tag:", "Root-Is-Purelib:"))]
    tags = ["Root-Is-Purelib: false", f"Tag: {next(sys_tags())}", ""]
    metadata.write_text("\n".join([*kept, *tags]), encoding="utf-8")


def installed(folder: Path, *requirements: str) -> Path:
    """Make an environment with requirements and what they need; return its Python."""
    venv.create(folder, symlinks=os.name != "nt")
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", *requirements)
    return python


def run(*command: Path | str, cwd: Path = ROOT, **variables: str) -> None:
    """Run a command, which has to succeed, with further variables in its environment."""
    environment = {"CFLAGS": "-O1 -g0", **os.environ, **variables}
    subprocess.run([str(each) for each in command], cwd=cwd, env=environment, check=True)


if __name__ == "__main__":
    sys.exit(main())
