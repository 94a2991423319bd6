"""The journal: the state of a node that must survive a restart.

- `port`: the contract of a store, and how a boot epoch follows from the one before;
- `memory`: a store that lasts as long as the process;
- `sqlite`: a store in a file, which survives ``kill -9`` and a power cut; `file`: how it writes;
  `image`, `mark`, `inspection`: its contents, and whether they are proved;
- `lives`: a journal whose boot epochs are lives of the seal;
- `backup`: copies, and the report on a journal's files;
- `thread`: commits in a thread of its own, in groups, repeated while they fail;
- `forgotten`: what a node without a lasting store forgets, in words.
"""

from zacoustic.run.journal.memory import MemoryJournal
from zacoustic.run.journal.port import EPOCHS, Journal, JournalState
from zacoustic.run.journal.sqlite import SqliteJournal, journal_in

__all__ = ["EPOCHS", "Journal", "JournalState", "MemoryJournal", "SqliteJournal", "journal_in"]
