"""Giving up a sample larger than a frame: ``@acoustic/ADDRESS/objects/cancel``.

The answer is ``{"cancelled": true}``, or false if it was already over::

    @acoustic/2/objects/cancel?id=7                    one that this node sends
    @acoustic/2/objects/cancel?source=1;transfer=12    one that this node receives
"""

from typing import TYPE_CHECKING, Final

import msgspec

from zacoustic.text.digits import whole_number
from zacoustic.zenoh.requests.context import Asking
from zacoustic.zenoh.requests.request import Parameter, Request

if TYPE_CHECKING:
    from zacoustic.core.engine.engine import Engine

_ALLOWED: Final = "id, or source and transfer; numbers"


class CancelAsked(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The sample to give up: `id`, or `source` and `transfer`.

    Raises:
        ValueError: They name none; with what is allowed.
    """

    id: int | None = None
    """Number of a sample that the node sends."""
    source: int | None = None
    """Address of the node from which the node receives it."""
    transfer: int | None = None
    """Number of that transfer."""

    def __post_init__(self) -> None:
        """Check that they name one."""
        if self.id is None and None in (self.source, self.transfer):
            raise ValueError(f"it names none; allowed: {_ALLOWED}")


class CancelAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """What came of it."""

    cancelled: bool
    """Whether it was given up; if not, it was already over."""


def _cancel(asking: Asking[CancelAsked, CancelAnswer], engine: "Engine", now: int) -> None:
    asked = asking.question
    if asked.id is not None:
        cancelled = engine.cancel_delivery(asked.id, now)
    else:
        assert asked.source is not None
        assert asked.transfer is not None
        cancelled = engine.refuse_object(asked.source, asked.transfer, now)
    asking.answer(CancelAnswer(cancelled=cancelled))


CANCEL: Final = Request(
    subject="objects/cancel",
    parameters=dict.fromkeys(("id", "source", "transfer"), Parameter(whole_number, _ALLOWED)),
    make=CancelAsked,
    answer=CancelAnswer,
    begin=_cancel,
    is_own=True,
)
"""Gives up a sample larger than a frame."""
