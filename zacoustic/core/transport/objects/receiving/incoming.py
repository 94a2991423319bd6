"""The receiver's side of one transfer: fragments become blocks, and blocks the object.

Until the manifest is complete, a bounded number of fragments are kept as they come. Then each goes
to its block, which is solved as soon as it has enough. The object is opened when all blocks are
solved, and only if its digest is right. Otherwise everything is dropped, and the feedback tells the
sender that all of it is missing.
"""

from typing import Final

from zacoustic.core.transport.objects.code.code import (
    BLOCK_FRAGMENTS,
    MOST_FRAGMENTS,
    Block,
    Layout,
)
from zacoustic.core.transport.objects.manifest import Manifest, decode_manifest, open_object
from zacoustic.core.wire.objects import MOST_BLOCKS, Feedback, Headless, Lacks

_MOST_EARLY: Final = 2 * BLOCK_FRAGMENTS
"""The most fragments that are kept without a manifest."""
_MOST_IN_HEAD: Final = 128
"""A manifest spans fewer fragments than this, even if each has four bytes."""
_ENOUGH_TO_JUDGE: Final = 8
_LOSS_UNKNOWN: Final = 0.3
"""The assumed loss if the first fragment has not arrived."""


class IncomingObject:
    """One object that is being received.

    Args:
        transfer: The source's number for it.
        fragment_bytes: Bytes of each fragment.
        largest_bytes: The largest payload that is accepted, bytes.
    """

    def __init__(self, transfer: int, fragment_bytes: int, largest_bytes: int) -> None:
        self.transfer = transfer
        self.fragment_bytes = fragment_bytes
        self.manifest: Manifest | None = None
        self.is_too_large = False
        """Whether its manifest exceeds a limit."""
        self._largest_bytes = largest_bytes
        self._early: dict[int, bytes] = {}
        self._head: dict[int, bytes] = {}
        self._layout: Layout | None = None
        self._blocks: list[Block] = []
        self._sources_held = 0
        self._sources_begun = 0

    def add(self, index: int, data: bytes) -> bool:
        """Add a fragment; return False if it is known or cannot be kept."""
        if self._layout is None:
            return self._add_early(index, data)
        new = self._add_to_block(self._layout, index, data)
        if new and self.lacking == 0 and self.payload() is None:
            # A fragment in it was never sent: start again.
            self._forget()
        return new

    @property
    def lacking(self) -> int | None:
        """How many fragments are lacking; None: unknown without a manifest."""
        if self._layout is None:
            return None
        return sum(block.lacking for block in self._blocks)

    @property
    def held(self) -> int:
        """How many needed fragments have arrived."""
        if self._layout is None:
            return len(self._early)
        return self._layout.fragments - sum(block.lacking for block in self._blocks)

    @property
    def memory_bytes(self) -> int:
        """The most bytes that it takes in memory."""
        if self.manifest is not None and not self.is_too_large:
            return self.manifest.coded_bytes
        return len(self._early) * self.fragment_bytes

    @property
    def fragments(self) -> int | None:
        """Number of source fragments; None without a manifest."""
        return self._layout.fragments if self._layout else None

    @property
    def loss(self) -> float:
        """The loss among the source fragments so far, 0…1."""
        if self._layout is None:
            return _LOSS_UNKNOWN
        if self._sources_begun < _ENOUGH_TO_JUDGE:
            return 0.0
        return 1 - self._sources_held / self._sources_begun

    def feedback(self) -> Feedback:
        """Return the feedback for an object that is incomplete, or waits for its turn."""
        if self._layout is None:
            return Headless(self.transfer, len(self._early))
        if not self.lacking:
            return Lacks(self.transfer, self._layout.blocks, (0,))
        first = next(number for number, block in enumerate(self._blocks) if block.lacking)
        last = first
        for number in range(first, min(first + MOST_BLOCKS, len(self._blocks))):
            if not self._blocks[number].is_empty:
                last = number
        lacking = tuple(block.lacking for block in self._blocks[first : last + 1])
        return Lacks(self.transfer, first, lacking)

    def contradicts(self, index: int, data: bytes) -> bool:
        """Return whether a fragment belongs to another object with the same number."""
        if len(data) != self.fragment_bytes:
            return True
        known = self._head.get(index)
        return known is not None and known != data

    def payload(self) -> bytes | None:
        """Return the payload of a complete object; None: it differs from the published one."""
        assert self.manifest is not None
        coded = b"".join(block.content() for block in self._blocks)
        return open_object(self.manifest, coded)

    def head(self) -> dict[int, bytes]:
        """Return the fragments with the manifest, which identify this object."""
        return self._head

    # Below the methods above

    def _add_early(self, index: int, data: bytes) -> bool:
        is_full = len(self._early) >= _MOST_EARLY and index >= _MOST_IN_HEAD
        if is_full or index in self._early or self.is_too_large:
            return False
        self._early[index] = data
        if index == len(self._head):
            self._read_manifest()
        return True

    def _read_manifest(self) -> None:
        while (data := self._early.get(len(self._head))) is not None:
            self._head[len(self._head)] = data
            manifest = decode_manifest(b"".join(self._head.values()))
            if manifest is not None:
                self._begin(manifest)
                return

    def _begin(self, manifest: Manifest) -> None:
        layout = Layout(-(-manifest.coded_bytes // self.fragment_bytes), self.fragment_bytes)
        self.manifest = manifest
        if manifest.payload_bytes > self._largest_bytes or layout.fragments > MOST_FRAGMENTS:
            self.is_too_large = True
            self._early.clear()
            return
        self._layout = layout
        self._blocks = [
            Block(number, layout.size(number), self.fragment_bytes)
            for number in range(layout.blocks)
        ]
        early, self._early = self._early, {}
        for index, data in early.items():
            self._add_to_block(layout, index, data)
        if self.lacking == 0 and self.payload() is None:
            self._forget()

    def _add_to_block(self, layout: Layout, index: int, data: bytes) -> bool:
        number = layout.block_of(index)
        block = self._blocks[number]
        if index >= layout.fragments:
            return block.add_repair(layout.seed(index), data)
        new = block.add_source(index - layout.first(number), data)
        if new:
            self._sources_held += 1
            self._sources_begun = max(self._sources_begun, index + 1)
        return new

    def _forget(self) -> None:
        self.manifest = None
        self._layout = None
        self._blocks = []
        self._head.clear()
        self._early.clear()
        self._sources_begun = self._sources_held = 0
