"""The journal: what a node must know after a restart.

- `port`: the contract of a store, and how a boot epoch follows from the one before;
- `memory`: a store that keeps nothing beyond the process;
- `sqlite`: a store in a file, which survives ``kill -9`` and the loss of power; `file`: how it is
  written; `image`, `mark`, `inspection`: its contents, and whether they are proved;
- `backup`: copies, and the state of a file;
- `thread`: commits in its own thread, in groups, and again while they fail;
- `forgotten`: what a node without a lasting store forgets, for people.
"""

from zacoustic.run.journal.memory import MemoryJournal
from zacoustic.run.journal.port import EPOCHS, Journal, JournalState
from zacoustic.run.journal.sqlite import SqliteJournal, journal_in

__all__ = ["EPOCHS", "Journal", "JournalState", "MemoryJournal", "SqliteJournal", "journal_in"]
