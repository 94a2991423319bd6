"""The compiled wheel beside plain Python: the same bytes, and how much faster.

    make compiled
    .venv/bin/python tests/benchmarks/bench_compiled.py WHEEL [HOURS] [ROUNDS]

The runs of the oracle, but for those that replace methods, must have the marks that are kept. Then
both simulate five nodes, a 30-byte message every ten seconds each (`bench_virtual_time.py`), one
after the other, each in a process of its own; the times are those of the processor. Exits 1 if a
run differs.
"""

import os
import resource
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
HOURS: Final = 6.0
ROUNDS: Final = 3
_SPIED: Final = "order"
"""Kind of the runs that replace a method of the engine, which compiled classes do not allow."""
_ORACLE: Final = f"""
import concurrent.futures
from tests.oracle.runs import NAMES, kept, run

if __name__ == "__main__":
    names = [name for name in NAMES if name.split()[0] != {_SPIED!r}]
    with concurrent.futures.ProcessPoolExecutor() as pool:
        found = dict(zip(names, pool.map(run, names), strict=True))
    differing = [name for name in names if kept()[name].difference(found[name])]
    print(f"{{len(names) - len(differing)}} of {{len(names)}} runs have the same bytes", *differing)
    raise SystemExit(bool(differing))
"""
_DAY: Final = "from tests.benchmarks.bench_virtual_time import run; run({hours})"


def main() -> int:
    """Print both."""
    if len(sys.argv) < 2:
        print(__doc__)
        return 2
    hours = float(sys.argv[2]) if len(sys.argv) > 2 else HOURS
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else ROUNDS
    with tempfile.TemporaryDirectory() as folder:
        zipfile.ZipFile(sys.argv[1]).extractall(folder)
        Path(folder, "tests").symlink_to(ROOT / "tests")
        compiled = Path(folder)
        same = _run(compiled, "-c", _ORACLE).returncode == 0
        print(f"{'five nodes for':14}  {'plain s':>8}  {'compiled s':>10}  ratio")
        for _ in range(rounds):
            plain_s, compiled_s = (
                _processor_s(place, _DAY.format(hours=hours)) for place in (ROOT, compiled)
            )
            ratio = plain_s / compiled_s
            print(f"{hours:12g} h  {plain_s:8.1f}  {compiled_s:10.1f}  {ratio:5.2f}", flush=True)
    return 0 if same else 1


def _processor_s(place: Path, program: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    _run(place, "-c", program).check_returncode()
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def _run(place: Path, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    """Run Python in a folder whose packages go first."""
    environment = {**os.environ, "PYTHONPATH": str(place)}
    return subprocess.run([sys.executable, *arguments], cwd=place, env=environment, check=False)


if __name__ == "__main__":
    sys.exit(main())
