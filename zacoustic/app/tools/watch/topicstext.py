"""Streams of gateways as a table of text: counts, rates, ages, waiting samples."""

from collections.abc import Sequence

from zacoustic.app.tools.columns import align, shortened_apart
from zacoustic.app.tools.watch.views import GatewayView, StreamView
from zacoustic.app.tools.watch.words import (
    rate_words,
    share_words,
    state_words,
    stream_cells,
    stream_words,
    time_words,
    title_words,
)
from zacoustic.text.safetext import one_line

_NARROW = ("id", "name", "way", "count", "last", "rate", "age", "waits", "airtime")
_NARROW_RIGHT = ("id", "count", "last", "age", "waits", "airtime")
_NAME_LETTERS = 24
"""Letters of a name in the narrow table; of a longer one as much as tells it apart."""
_HEADER = ("id", "name", "kind", "sent", "last", "rate", "heard", "last", "rate", "age", "waits",
           "airtime", "")  # fmt: skip
_RIGHT = ("id", "sent", "last", "rate", "heard", "age", "waits", "airtime")


def topics_text(view: GatewayView) -> str:
    """Return the table of one gateway, with a line about it on top."""
    rows = [
        (str(stream.id), stream.name, stream.kind, *stream_cells(stream)) for stream in view.streams
    ]
    head = one_line(f"gateway {title_words(view)}: {state_words(view)}")
    return f"{head}\n{align(_HEADER, rows, right=_RIGHT)}"


def streams_text(view: GatewayView, kind: str) -> str:
    """Return the streams of a kind, within 80 columns; what is wrong with one is a line of its own.

    Args:
        view: The gateway.
        kind: ``topic``, ``service`` or ``action``.
    """
    streams = [stream for stream in view.streams if stream.kind == kind]
    head = one_line(f"gateway {title_words(view)}: {state_words(view)}")
    if not streams:
        return f"{head}\nno {kind}s"
    names = shortened_apart([stream.name for stream in streams], _NAME_LETTERS)
    rows = [
        row
        for stream, name in zip(streams, names, strict=True)
        for row in _narrow_rows(stream, name)
    ]
    notes = [
        one_line(f"{stream.name}: {words}") for stream in streams if (words := stream_words(stream))
    ]
    return "\n".join([head, align(_NARROW, rows, right=_NARROW_RIGHT), *notes])


def _narrow_rows(stream: StreamView, name: str) -> list[Sequence[str]]:
    """Return a row for each way that is used, and one of a stream that is not."""
    waits, share = str(stream.waiting), share_words(stream.airtime_share)
    rows: list[Sequence[str]] = []
    if stream.sent or stream.waiting:
        last, rate = time_words(stream.sent_ago_s), rate_words(stream.sent_rate_hz)
        rows.append((str(stream.id), name, "out", str(stream.sent), last, rate, "", waits, share))
    if stream.heard:
        last, rate = time_words(stream.heard_ago_s), rate_words(stream.heard_rate_hz)
        age = time_words(stream.age_s)
        more = ("", "") if rows else (waits, share)
        rows.append((str(stream.id), name, "in", str(stream.heard), last, rate, age, *more))
    return rows or [(str(stream.id), name, "", "0", "", "", "", waits, share)]
