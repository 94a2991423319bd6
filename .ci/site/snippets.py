"""Check the types of every program that the pages of docs/ and the README show: mypy and pyright.

A block of Python counts if it is whole: it begins with an import. Both tools run strictly.
Run it: `make docs`, or .venv-docs/bin/python .ci/site/snippets.py
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
PAGES: Final = ("README.md", "docs/features.md", "docs/api/*.md", "docs/howto/*.md")

_BLOCK: Final = re.compile(
    r"^```python\n((?:#[^\n]*\n)?(?:import|from) .*?)^```$", re.DOTALL | re.MULTILINE
)


def main() -> int:
    """Write each program to a file of its own, and check all of them at once."""
    with tempfile.TemporaryDirectory() as folder:
        count = 0
        for page in sorted(each for pattern in PAGES for each in ROOT.glob(pattern)):
            for number, text in enumerate(_BLOCK.findall(page.read_text(encoding="utf-8"))):
                name = "_".join(page.relative_to(ROOT).with_suffix("").parts)
                Path(folder, f"{name}_{number}.py").write_text(text, encoding="utf-8")
                count += 1
        if not count:
            raise SystemExit("snippets: found none")
        settings = {
            "typeCheckingMode": "strict",
            "extraPaths": [str(ROOT), str(ROOT / "links")],
            "pythonVersion": "3.11",
        }
        Path(folder, "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
        paths = os.pathsep.join((str(ROOT), str(ROOT / "links")))
        mypy = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "."]
        pyright = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "."]
        failed = 0
        for command in (mypy, pyright):
            environment = {**os.environ, "MYPYPATH": paths}
            failed |= subprocess.run(command, cwd=folder, env=environment, check=False).returncode
        print(f"{count} snippets: {'FAILED' if failed else 'types are right'}")
        return failed


if __name__ == "__main__":
    sys.exit(main())
