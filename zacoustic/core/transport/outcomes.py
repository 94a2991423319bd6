"""The ends of journalled samples, kept until the application has taken them.

The entry of a sample goes when the sample ends. A crash between that and the event would end it
without a word, so the end is journalled first, under the delivery id, and deleted when the
application has taken the event. A later life that finds an end tells it once more: the end of a
journalled sample comes at least once, and always the same.
"""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.transport.deliveries import DeliveryEnded, DeliveryOutcome

_OUTCOME: Final = "outcome"


class _Kept(msgspec.Struct, frozen=True, array_like=True):
    stream_id: int
    outcome: DeliveryOutcome
    missing: tuple[int, ...]
    detail: str = ""


class Outcomes:
    """The ends of one node's journalled samples on one link.

    Args:
        journal: Holds them.
        emit: Takes each end when it is committed.
    """

    def __init__(self, journal: JournalPort, emit: Callable[[DeliveryEnded], None]) -> None:
        self._journal = journal
        self._emit = emit
        self._untaken: set[int] = set()

    @property
    def highest_id(self) -> int:
        """The highest delivery id whose end the application has not taken, or 0."""
        return max(self._untaken, default=0)

    def has(self, delivery_id: int) -> bool:
        """Return whether a sample has ended and the application has not taken that yet."""
        return delivery_id in self._untaken

    def tell(self, ended: DeliveryEnded, *, is_dated: bool = True) -> None:
        """Journal an end, then emit it; the caller deletes the sample's own entry after that.

        Args:
            ended: The end.
            is_dated: Its instant is known; otherwise it is that of the event.
        """
        self._untaken.add(ended.delivery_id)
        kept = _Kept(ended.stream_id, ended.outcome, ended.missing, ended.detail)

        def committed(at: int) -> None:
            self._emit(ended if is_dated else msgspec.structs.replace(ended, ended_at=at))

        self._journal.write(_key(ended.delivery_id), msgspec.msgpack.encode(kept), committed)

    def taken(self, delivery_id: int) -> None:
        """Forget an end: the application has it."""
        if delivery_id in self._untaken:
            self._untaken.remove(delivery_id)
            self._journal.write(_key(delivery_id), None)

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Tell the ends again that no earlier life is known to have told."""
        for key in sorted(stored):
            kind, _, delivery_id = key.partition("/")
            if kind == _OUTCOME:
                kept = msgspec.msgpack.decode(stored[key], type=_Kept)
                ended = DeliveryEnded(
                    delivery_id=int(delivery_id),
                    stream_id=kept.stream_id,
                    outcome=kept.outcome,
                    missing=kept.missing,
                    ended_at=0,
                    detail=kept.detail,
                )
                self.tell(ended, is_dated=False)


def _key(delivery_id: int) -> str:
    return f"{_OUTCOME}/{delivery_id:020}"
