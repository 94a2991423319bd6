"""The journal of a node in a `VirtualNetwork`: a dictionary that survives its engine.

It behaves like a real one: writes during a commit wait for the next one, a commit takes time, and
is complete or absent. A crash during a commit loses it, unless it was written without a report
(probability `JournalSpec.untold`).
"""

import random
from collections.abc import Mapping
from typing import Final

from zacoustic.channel.faults.nodefaults import JournalSpec
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.journal import DOUBT_KEY, EPOCH_KEY, LIFE_KEY, JournalWrite

_EPOCHS: Final = 1 << 16

FULL: Final = "no space left on the device"
"""The error of a node while nothing can be written."""


class VirtualJournal:
    """The store of one node.

    Args:
        node: Address.
        spec: Time of a commit, and faults.
    """

    def __init__(self, node: int, spec: JournalSpec) -> None:
        self.entries: dict[str, bytes] = {}
        """The committed entries."""
        self.handed_out = 0
        """Writes taken from engines so far, in all boot epochs."""
        self.committed = 0
        """How many of those are settled: committed, or lost in a crash."""
        self.commit_ns = seconds_to_ns(spec.commit_s)
        self._spec = spec
        self._fails = [
            (seconds_to_ns(span.from_s), seconds_to_ns(span.to_s))
            for span in spec.fails
            if span.node == node
        ]
        self._lost: list[tuple[int, int]] = []
        self._waiting: list[JournalWrite] = []
        self._group: list[JournalWrite] = []
        self._rng = random.Random(f"journal of node {node}")
        self._doubt: str | None = None

    @property
    def is_idle(self) -> bool:
        """Whether no commit is under way."""
        return not self._group

    def is_journalled(self, number: int) -> bool:
        """Tell whether the write with this number, as counted by `handed_out`, is committed."""
        lost = any(first <= number <= last for first, last in self._lost)
        return number <= self.committed and not lost

    def put_back(self, entries: Mapping[str, bytes], doubt: str = "") -> None:
        """Restore an old copy of the entries while the node is down.

        Args:
            entries: The copy.
            doubt: What the store detects; empty: nothing, as for an image of the disk.
        """
        self.entries = dict(entries)
        self._doubt = doubt

    def begin_life(self) -> int:
        """Begin a boot epoch as a store in a file does, and return it.

        Unlike there, the next epoch is the one after the last, unless an old copy was restored.
        """
        doubt, self._doubt = self._doubt, None
        kept = self.entries.get(EPOCH_KEY)
        epoch = 1 if kept is None else int.from_bytes(kept, "big") + 1
        life = int.from_bytes(self.entries.get(LIFE_KEY, b""), "big") + 1
        if doubt:
            epoch, life = self._rng.randrange(_EPOCHS), life + self._rng.randrange(1 << 10, 1 << 20)
            self.entries[DOUBT_KEY] = doubt.encode()
        elif doubt is not None:
            epoch += 64 * self._rng.randrange(1 << 10)
        self.entries[EPOCH_KEY] = (epoch % _EPOCHS).to_bytes(2, "big")
        self.entries[LIFE_KEY] = life.to_bytes(8, "big")
        return epoch % _EPOCHS

    def add(self, write: JournalWrite) -> None:
        """Take a write from an engine."""
        self.handed_out += 1
        self._waiting.append(write)

    def begin(self) -> bool:
        """Begin to commit the waiting writes; False: there are none."""
        self._group, self._waiting = self._waiting, []
        return bool(self._group)

    def fails_until(self, now: int) -> int | None:
        """Return when writing works again, ns; None: it works now."""
        return next((end for begin, end in self._fails if begin <= now < end), None)

    def finish(self) -> list[JournalWrite]:
        """Complete the commit under way and return its writes."""
        group, self._group = self._group, []
        self._keep(group)
        self.committed += len(group)
        return group

    def crash(self, draw: float) -> None:
        """Forget uncommitted writes.

        Args:
            draw: Decides whether a commit under way was written, 0…1.
        """
        if self._group and draw < self._spec.untold:
            self._keep(self._group)
            self.committed += len(self._group)
        self._group, self._waiting = [], []
        if self.committed < self.handed_out:
            self._lost.append((self.committed + 1, self.handed_out))
        self.committed = self.handed_out
        if self._spec.keeps is False:
            self._lost = [(1, self.handed_out)]
            self.entries = {key: self.entries[key] for key in self.entries if key == EPOCH_KEY}

    def _keep(self, group: list[JournalWrite]) -> None:
        for write in group:
            if write.value is None:
                self.entries.pop(write.key, None)
            else:
                self.entries[write.key] = write.value
