"""Streams of gateways as a table of text: counts, rates, ages, waiting samples."""

from collections.abc import Sequence

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.watch.views import GatewayView
from zacoustic.app.tools.watch.words import (
    rate_words,
    share_words,
    state_words,
    stream_words,
    time_words,
    title_words,
)
from zacoustic.text.safetext import one_line

_HEADER = ("id", "name", "kind", "sent", "last", "rate", "heard", "last", "rate", "age", "waits",
           "airtime", "")  # fmt: skip
_RIGHT = ("id", "sent", "last", "rate", "heard", "age", "waits", "airtime")


def topics_text(view: GatewayView) -> str:
    """Return the table of one gateway, with a line about it on top."""
    rows = [_row(view, index) for index in range(len(view.streams))]
    head = one_line(f"gateway {title_words(view)}: {state_words(view)}")
    return f"{head}\n{align(_HEADER, rows, right=_RIGHT)}"


def _row(view: GatewayView, index: int) -> Sequence[str]:
    stream = view.streams[index]
    return (
        str(stream.id),
        stream.name,
        stream.kind,
        str(stream.sent),
        time_words(stream.sent_ago_s),
        rate_words(stream.sent_rate_hz),
        str(stream.heard),
        time_words(stream.heard_ago_s),
        rate_words(stream.heard_rate_hz),
        time_words(stream.age_s),
        str(stream.waiting),
        share_words(stream.airtime_share),
        stream_words(stream),
    )
