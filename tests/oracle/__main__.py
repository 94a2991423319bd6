"""``python -m tests.oracle``: runs of the oracle by hand.

Without a name all are run and compared with those that are kept; with ``--keep`` they are kept
instead. With a name (``python -m tests.oracle story 12``) each frame of that run is a line, so that
`diff` finds the first one in which two versions differ.
"""

import argparse
import concurrent.futures
import sys

import msgspec

from tests.oracle.runs import KEPT, NAMES, kept, run


def main() -> int:
    """Do what the arguments say; returns 0 if all are the same."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracle", description=__doc__)
    parser.add_argument("name", nargs="*", help="kind and seed of one run")
    parser.add_argument("--keep", action="store_true", help="keep the marks of this version")
    arguments = parser.parse_args()
    if arguments.name:
        run(" ".join(arguments.name), sys.stdout)
        return 0
    with concurrent.futures.ProcessPoolExecutor() as pool:
        found = dict(zip(NAMES, pool.map(run, NAMES), strict=True))
    if arguments.keep:
        lines = (f"{msgspec.json.encode(name).decode()}: {msgspec.json.encode(marks).decode()}"
                 for name, marks in found.items())  # fmt: skip
        KEPT.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
        return 0
    before = kept()
    differing = {name: before[name].difference(marks) for name, marks in found.items()}
    for name, difference in differing.items():
        if difference:
            print(f"{name}: {difference}")
    return 1 if any(differing.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
