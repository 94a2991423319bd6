"""Opens sealed frames with the key of their fleet, in any order.

A receiver knows values that the frame lacks (source, destination, link, the counter behind a short
head). The opener tries them out: at most some thousand combinations, each of some microseconds. A
short head needs an earlier long one of the same source. Without a key only the head of a frame is
described.
"""

import itertools
from collections.abc import Iterator, Sequence

import msgspec

from zacoustic.app.tools.inspect.decode.decoded import DecodedItem
from zacoustic.app.tools.inspect.decode.decoder import FrameDecoder
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.peers.replay import Window, life_of
from zacoustic.core.wire.seal import (
    NO_TABLE,
    Cipher,
    LongHead,
    SealedFrame,
    Way,
    associated_data,
    is_strong,
    nonce,
    parse_sealed,
)

_NO_KEY = "needs the key of its fleet: a configuration with `security`"
_NOT_OPENED = (
    "does not open: another key or table, damaged, or a short head before any long one of its node"
)


class Opening(msgspec.Struct, frozen=True, kw_only=True):
    """The result of opening a frame."""

    item: DecodedItem
    """Description of its seal."""
    source: int
    """The sender; 0: unknown."""
    destination: int
    """The destination."""
    records: bytes | None = None
    """Its contents; None: it does not open."""


class FrameOpener:
    """Opens sealed frames, one after the other.

    Args:
        cipher: The keys; None: no frame is opened.
        nodes: Addresses of the fleet, for frames without a source.
        ports: Numbers of its links.
        digest: Digest of its table.
    """

    def __init__(
        self,
        cipher: Cipher | None = None,
        *,
        nodes: Sequence[int] = (),
        ports: Sequence[int] = (0,),
        digest: bytes = NO_TABLE,
    ) -> None:
        self._cipher = cipher
        self._nodes = nodes
        self._ports = ports
        self._digests = tuple(dict.fromkeys((digest, NO_TABLE)))
        self._windows: dict[Way, Window] = {}
        self._newest: dict[int, int] = {}

    def open(self, frame: bytes, *, source: int = 0, destination: int | None = None) -> Opening:
        """Open a frame; never raises.

        Args:
            frame: The frame without the envelope of link or core.
            source: The sender; 0: unknown.
            destination: The destination; None: unknown.
        """
        unknown = BROADCAST if destination is None else destination
        sealed = parse_sealed(frame)
        if sealed is None:
            text = f"SEALED {len(frame)} bytes: cut short, or not sealed"
            item = DecodedItem(kind="sealed", text=text, fault="cut short, or not sealed")
            return Opening(item=item, source=source, destination=unknown)
        if self._cipher is None:
            return Opening(item=_closed(sealed, _NO_KEY), source=source, destination=unknown)
        generation = self._cipher.generation
        generation -= (generation ^ sealed.head.generation) & 1
        for way in self._ways(sealed, source, destination):
            opened = self._try(self._cipher, sealed, way, generation)
            if opened is not None:
                item, records = opened
                return Opening(
                    item=item, source=way.source, destination=way.destination, records=records
                )
        return Opening(item=_closed(sealed, _NOT_OPENED), source=source, destination=unknown)

    def _ways(self, sealed: SealedFrame, source: int, destination: int | None) -> Iterator[Way]:
        sources = (source,) if source else self._nodes
        destinations = (BROADCAST, *self._nodes) if destination is None else (destination,)
        strong = is_strong(sealed.head)
        for each, whom, port in itertools.product(sources, destinations, self._ports):
            if each != whom:
                yield Way(each, whom, port, strong)

    def _try(
        self, cipher: Cipher, sealed: SealedFrame, way: Way, generation: int
    ) -> tuple[DecodedItem, bytes] | None:
        window = self._windows.get(way) or Window()
        newest = self._newest.get(way.source, -1)
        for start, counter in window.candidates(sealed.head, generation, newest):
            number = nonce(way, life_of(start), counter)
            for digest in self._digests:
                associated = associated_data(sealed.head_bytes, way, digest)
                records = cipher.open(sealed.head.generation, way, number, sealed.body, associated)
                if records is None:
                    continue
                if window.is_new(start, counter):
                    window.note(start, counter)
                self._windows[way] = window
                self._newest[way.source] = max(start, newest)
                return _opened(sealed, way, generation, life_of(start), counter, digest), records
        return None


def said_in(
    decoder: FrameDecoder,
    opener: FrameOpener | None,
    frame: bytes,
    source: int,
    destination: int | None,
    *,
    unicast: bool,
) -> list[DecodedItem]:
    """Explain a frame, and before that its seal, if it has one; never raises.

    Args:
        decoder: Explains the contents.
        opener: Opens the frame; None: it is not sealed.
        frame: The frame without its envelope.
        source: The sender; 0: unknown.
        destination: The destination; None: unknown.
        unicast: The frame is known to be for one node.
    """
    if opener is None:
        return decoder.decode(frame, source=source, unicast=unicast)
    found = opener.open(frame, source=source, destination=destination)
    if found.records is None:
        return [found.item]
    unicast = found.destination != BROADCAST
    return [found.item, *decoder.decode(found.records, source=found.source, unicast=unicast)]


def _opened(
    sealed: SealedFrame, way: Way, generation: int, life: int, counter: int, digest: bytes
) -> DecodedItem:
    whom = "everybody" if way.destination == BROADCAST else f"node {way.destination}"
    table = "read without a table" if digest == NO_TABLE else f"table {digest.hex()}"
    text = (
        f"SEALED by node {way.source} to {whom}, generation {generation}, {_head_text(sealed)}, "
        f"life {life}, counter {counter}, {table}"
    )
    value = {
        "source": way.source,
        "destination": way.destination,
        "port": way.port,
        "generation": generation,
        "life": life,
        "counter": counter,
        "strong": way.strong,
        "table": "" if digest == NO_TABLE else digest.hex(),
    }
    return DecodedItem(kind="sealed", text=text, value=value)


def _closed(sealed: SealedFrame, why: str) -> DecodedItem:
    head = sealed.head
    text = f"SEALED {_head_text(sealed)}"
    if isinstance(head, LongHead):
        text += f", life {head.life}, counter {head.counter}"
    else:
        text += f", counter {head.low} modulo 64"
    parity = "odd" if head.generation else "even"
    return DecodedItem(kind="sealed", text=f"{text}, an {parity} generation: {why}", fault=why)


def _head_text(sealed: SealedFrame) -> str:
    length = "long" if isinstance(sealed.head, LongHead) else "short"
    strength = "strong" if is_strong(sealed.head) else "ordinary"
    return f"{length} head, {strength} tag of {sealed.tag_bytes} bytes"
