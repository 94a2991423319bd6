"""Samples larger than a frame: their progress, and how to cancel one.

``@acoustic/ADDRESS/objects`` is a document of the health report: what is being sent, what is
arriving, and how the last ones ended. A `get` on ``@acoustic/ADDRESS/objects/cancel`` cancels one;
the answer is ``{"cancelled": true}``, or false if it was already over::

    @acoustic/2/objects/cancel?id=7                    one that this node sends
    @acoustic/2/objects/cancel?source=1;transfer=12    one that this node receives
"""

from collections import deque
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailure
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.values.encoding import JSON
from zacoustic.run.runner import LinkRunner
from zacoustic.text.digits import whole_number
from zacoustic.zenoh.session.asking.commands import PREFIX
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery

_ENDED_KEPT: Final = 8
_OWN: Final = ("id",)
_OTHERS: Final = ("source", "transfer")


class ObjectHandler:
    """The large samples of one gateway; for the loop.

    Args:
        table: The streams.
        runner: Runs the engine.
    """

    def __init__(self, table: StreamTable, runner: LinkRunner) -> None:
        self._table = table
        self._runner = runner
        self._sending: dict[int, ObjectProgress] = {}
        self._receiving: dict[tuple[int, int], ObjectProgress] = {}
        self._ended: deque[ObjectProgress] = deque(maxlen=_ENDED_KEPT)

    @property
    def key(self) -> str:
        """Key of the queryable that cancels."""
        return f"{PREFIX}/{self._runner.engine.address}/objects/cancel"

    def note(self, event: ObjectProgress) -> None:
        """Note the progress or the end of one."""
        if event.object_id is not None:
            self._sending.pop(event.object_id, None)
        else:
            self._receiving.pop((event.peer, event.transfer), None)
        if event.state is not ObjectState.UNDER_WAY:
            self._ended.append(event)
        elif event.object_id is not None:
            self._sending[event.object_id] = event
        else:
            self._receiving[event.peer, event.transfer] = event

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key."""
        return {"objects": self._document()}

    def _document(self) -> dict[str, object]:
        return {
            "sending": [self._described(each) for each in self._sending.values()],
            "receiving": [self._described(each) for each in self._receiving.values()],
            "ended": [
                self._described(each)
                | {
                    "outcome": each.state.value,
                    "missing": list(each.missing),
                    "detail": each.detail,
                }
                for each in self._ended
            ],
        }

    def serve(self, held: HeldQuery) -> None:
        """Take a query; a wildcard never cancels anything."""
        if not str(held.query.key_expr).endswith("/cancel"):
            held.answer([])
            return
        wanted = _read(held)
        if wanted is None:
            held.refuse(CallFailure.BAD_REQUEST, "allowed: id, or source and transfer; numbers")
            return

        def cancel(engine: Engine, now: int) -> bool:
            if len(wanted) == len(_OWN):
                return engine.cancel_delivery(wanted[0], now)
            return engine.refuse_object(wanted[0], wanted[1], now)

        payload = msgspec.json.encode({"cancelled": self._runner.apply(cancel)})
        held.answer([Answer(key=self.key, payload=payload, encoding=JSON)])

    def _described(self, event: ObjectProgress) -> dict[str, object]:
        stream = self._table.get(event.stream_id)
        peer = None if event.peer == BROADCAST else event.peer
        which: dict[str, object] = {"source": event.peer, "transfer": event.transfer}
        if event.object_id is not None:
            which = {"id": event.object_id, "to": peer, "sent_bytes": event.sent_bytes}
        return which | {
            "stream": stream.name if stream is not None else None,
            "done_bytes": event.done_bytes,
            "total_bytes": event.total_bytes,
        }


def _read(held: HeldQuery) -> list[int] | None:
    """Read the parameters; None: they name no object."""
    parameters = held.query.parameters
    for names in (_OWN, _OTHERS):
        numbers = [whole_number(parameters.get(name) or "") for name in names]
        if None not in numbers:
            return [each for each in numbers if each is not None]
    return None
