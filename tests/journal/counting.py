"""A process that counts in a journal until it is killed, and what must be found afterwards.

The journal of step n holds the number n, and a text of its own for each of the last steps: each
step writes two keys and deletes one, all or none. Each number is printed when it is committed::

    python -m tests.journal.counting FILE ADDRESS
"""

import os
import random
import sys
from collections.abc import Mapping
from typing import Final

from zacoustic.core.base.journal import EPOCH_KEY, LIFE_KEY, JournalWrite
from zacoustic.run.journal import SqliteJournal

NUMBER_KEY: Final = "number"
STEPS_KEPT: Final = 3
# A step of many pages is the more easily cut in two, and the log is soon long enough to be
# written back into the file.
LONGEST_TEXT_BYTES: Final = 12_000


def step(number: int) -> list[JournalWrite]:
    """The writes of a step."""
    values = {
        NUMBER_KEY: str(number).encode(),
        f"text-{number}": text(number),
        f"text-{number - STEPS_KEPT}": None,
    }
    return [JournalWrite(write_id=0, key=key, value=value) for key, value in values.items()]


def text(number: int) -> bytes:
    rng = random.Random(number)
    return rng.randbytes(rng.randint(1, LONGEST_TEXT_BYTES))


def entries_after(number: int) -> dict[str, bytes]:
    """What a journal holds after that many steps, but for what it says of its life."""
    if number == 0:
        return {}
    kept = range(max(1, number - STEPS_KEPT + 1), number + 1)
    return {NUMBER_KEY: str(number).encode(), **{f"text-{each}": text(each) for each in kept}}


def number_in(entries: Mapping[str, bytes]) -> int:
    """The number of whole steps; fails when it is not exactly them."""
    found = {key: value for key, value in entries.items() if key not in (EPOCH_KEY, LIFE_KEY)}
    number = int(found.get(NUMBER_KEY, b"0"))
    assert found == entries_after(number)
    return number


def main() -> None:
    journal = SqliteJournal(sys.argv[1], int(sys.argv[2]))
    os.write(1, b"begins\n")
    state = journal.recover()
    assert not state.doubt, state.doubt
    os.write(1, f"epoch {state.boot_epoch}\n".encode())
    number = number_in(state.entries)
    while True:
        number += 1
        journal.commit(step(number))
        os.write(1, f"{number}\n".encode())


if __name__ == "__main__":
    main()
