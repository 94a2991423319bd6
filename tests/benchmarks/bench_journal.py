"""How many commits a journal in a file makes in a second, and how large a group costs no more.

Commits wait for the disk, so the figures are the disk's: beside them stands how often a second the
disk can be waited for at all. A commit of one write is what a single reliable message costs; writes
that come while it is under way go together into the next, so the larger groups say what a node can
promise at most in a second. Must hold: a commit of one write takes no more than twice a bare wait.

    python tests/benchmarks/bench_journal.py [--folder FOLDER] [--commits N] [--strict]
"""

import argparse
import os
import random
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from zacoustic.core.base.journal import JournalWrite
from zacoustic.run.journal import SqliteJournal

LIMIT: Final = 2.0
"""How many bare waits a commit of one write may take, in the median."""
GROUPS: Final = (1, 8, 64, 512)
VALUE_BYTES: Final = 100
KEYS: Final = 2000
_PAGE_BYTES: Final = 4096


def main() -> int:
    """Measure, print a table, and say whether the limit holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="on the disk to measure (default: temporary)")
    parser.add_argument("--commits", type=int, default=300, help="commits of each kind")
    parser.add_argument(
        "--strict", action="store_true", help="exit with 1 when the limit is missed"
    )
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        durations_s = measure(Path(folder), arguments.commits)
    print(f"journal in a file, {VALUE_BYTES}-byte values, {arguments.commits} commits each")
    print(f"{'':24}{'a second':>10}{'writes/s':>10}{'p50 ms':>9}{'p99 ms':>9}")
    for size, each_s in durations_s.items():
        show(f"commit of {size}" if size else "bare wait for the disk", each_s, max(1, size))
    ratio = percentile(durations_s[1], 0.5) / percentile(durations_s[0], 0.5)
    holds = ratio <= LIMIT
    verdict = "holds" if holds else "MISSED"
    print(f"commit of one: {ratio:.2f} bare waits, limit {LIMIT:g}: {verdict}")
    return 1 if arguments.strict and not holds else 0


def measure(folder: Path, times: int) -> dict[int, list[float]]:
    """Do each kind of commit, turn by turn; returns how long each took, s. 0 is a bare wait."""
    rng, durations_s = random.Random(1), {size: list[float]() for size in (0, *GROUPS)}
    descriptor = os.open(folder / "bare", os.O_RDWR | os.O_CREAT)
    wait = getattr(os, "fdatasync", os.fsync)
    journals = {size: SqliteJournal(folder / f"{size}.sqlite", 1) for size in GROUPS}
    for journal in journals.values():
        journal.recover()
    try:
        for _ in range(times):
            page = rng.randbytes(_PAGE_BYTES)
            began = time.perf_counter()
            os.write(descriptor, page)
            wait(descriptor)
            durations_s[0].append(time.perf_counter() - began)
            for size, journal in journals.items():
                group = [write(rng) for _ in range(size)]
                began = time.perf_counter()
                journal.commit(group)
                durations_s[size].append(time.perf_counter() - began)
    finally:
        os.close(descriptor)
        for journal in journals.values():
            journal.close()
    return durations_s


def write(rng: random.Random) -> JournalWrite:
    """Make a write of one of many keys."""
    key = f"key-{rng.randrange(KEYS)}"
    return JournalWrite(write_id=0, key=key, value=rng.randbytes(VALUE_BYTES))


def show(name: str, durations_s: Sequence[float], size: int) -> None:
    """Print one line."""
    rate = len(durations_s) / sum(durations_s)
    p50_ms, p99_ms = (1000 * percentile(durations_s, share) for share in (0.5, 0.99))
    print(f"{name:24}{rate:10.0f}{rate * size:10.0f}{p50_ms:9.2f}{p99_ms:9.2f}")


def percentile(values: Sequence[float], share: float) -> float:
    """The value below which that share lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


if __name__ == "__main__":
    raise SystemExit(main())
