"""The journal port: what an engine wants written down before it promises anything.

The core has no files. It hands out `JournalWrite`s by `poll_journal` and waits for
`handle_journal_committed` before it does what depends on them; the shell commits them in groups,
in a thread of its own. Here one promise depends on it: a boot epoch is committed before the first
HELLO that carries it, so that no two lives of a node share an epoch.
"""

import msgspec


class JournalWrite(msgspec.Struct, frozen=True, kw_only=True):
    """One entry; replaces what was written under the same key before."""

    write_id: int
    """Counted by the engine; `handle_journal_committed` names it."""
    key: str
    """What it is about, such as ``epoch``."""
    value: bytes
    """The content."""


EPOCH_KEY = "epoch"
"""Key of the boot epoch: two bytes, big-endian."""
