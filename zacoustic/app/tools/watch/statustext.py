"""A gateway in ten lines: link, load, nodes, and the streams that fail; a table of nodes."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

import msgspec

from zacoustic.app.tools.columns import align, shortened, shortened_apart
from zacoustic.app.tools.watch.views import GatewayView, PeerView, StreamView, told
from zacoustic.app.tools.watch.ways import carried_words
from zacoustic.app.tools.watch.words import (
    NOTHING,
    is_well,
    load_words,
    number_words,
    range_words,
    share_words,
    size_words,
    state_words,
    stream_words,
    time_words,
    title_words,
    trouble_words,
    waits_words,
)
from zacoustic.text.safetext import one_line

_MOST_NODES: Final = 4
"""Most nodes in a status, those that were heard last."""
_MOST_STREAMS: Final = 3
"""Most failing streams in a status, and most carried ones."""
_NAME_LETTERS: Final = 16
_LINK_LETTERS: Final = 12
_TOPIC_LETTERS: Final = 24
_WIDTH: Final = 80
_HEADER: Final = ("node", "name", "heard", "signal", "range", "loss", "link", "")
_UNDELIVERED: Final = ("expired", "cancelled", "unknown")
"""Outcomes of reliable samples that have not arrived."""


class FailingStream(msgspec.Struct, frozen=True, kw_only=True):
    """A stream that fails."""

    id: int
    """Stream id."""
    name: str
    """Its name."""
    why: str
    """What is wrong, in words."""
    is_stopped: bool
    """Its definition differs at another node, or it misses deadlines: it needs somebody."""


class HeardNode(msgspec.Struct, frozen=True, kw_only=True):
    """Another node."""

    address: int
    """Acoustic address."""
    name: str
    """Name in the table."""
    heard_ago_s: float | None
    """Time since its last frame, s; None: never."""
    trouble: str
    """Its fault, in words; empty: none."""


_MEMBERS: Final = (
    "address", "name", "link", "uptime_s", "utilisation", "frames_sent", "frames_heard",
    "frames_damaged", "waiting", "waits", "carry",
)  # fmt: skip
"""Members of a view that its status has as well."""


def status_of(view: GatewayView) -> dict[str, Any]:
    """Return the status of a gateway as JSON holds it.

    That is some members of its view, its ``state`` in words, ``is_well``, the other ``nodes``, the
    last heard first, and the streams that are ``failing``, stopped ones first.
    """
    shown = told(view)
    return {name: shown[name] for name in _MEMBERS} | {
        "is_well": goes_well(view),
        "state": state_words(view),
        "nodes": [told(each) for each in nodes_of(view)],
        "failing": [told(each) for each in failing_of(view)],
    }


def goes_well(view: GatewayView) -> bool:
    """Tell whether nothing prevents transmission, and no stream is stopped."""
    return is_well(view) and not any(each.is_stopped for each in failing_of(view))


def failing_of(view: GatewayView) -> list[FailingStream]:
    """Return the streams that fail, stopped ones first."""
    return sorted(_failing(view.streams), key=lambda each: not each.is_stopped)


def nodes_of(view: GatewayView) -> list[HeardNode]:
    """Return the other nodes, the last heard first."""
    nodes = [
        HeardNode(
            address=peer.address,
            name=peer.name,
            heard_ago_s=peer.heard_ago_s,
            trouble=trouble_words(peer),
        )
        for peer in view.peers
    ]
    never = float("inf")
    return sorted(nodes, key=lambda each: never if each.heard_ago_s is None else each.heard_ago_s)


def status_text(view: GatewayView) -> str:
    """Return a gateway in about ten lines."""
    return "\n".join(_cut(one_line(line)) for line in _lines(view))


def nodes_text(view: GatewayView) -> str:
    """Return the other nodes of a gateway as a table within 80 columns."""
    head = one_line(f"gateway {title_words(view)}: {state_words(view)}")
    if not view.peers:
        return f"{head}\nno other nodes"
    rows = [_row(peer) for peer in view.peers]
    table = align(_HEADER, rows, right=("node", "heard", "signal", "range", "loss"))
    notes = [
        one_line(f"{peer.address} {peer.name}: {words}")
        for peer in view.peers
        if (words := trouble_words(peer))
    ]
    return "\n".join([head, table, *notes])


def _lines(view: GatewayView) -> Iterator[str]:
    nodes, failing = nodes_of(view), failing_of(view)
    yield f"gateway {title_words(view)}: {state_words(view)}"
    runs = f"the gateway runs for {time_words(view.uptime_s)}"
    yield f"  link     {view.link or NOTHING}: {view.whole.state}; {runs}"
    damaged = f" ({view.frames_damaged} damaged)" if view.frames_damaged else ""
    counts = f"{view.whole.frames_sent} frames sent, {view.whole.frames_heard} heard{damaged}"
    yield f"  on air   {load_words(view)}; {counts}"
    why = waits_words(view.whole.waits)
    waiting = f"{view.waiting} samples, calls and goals" if view.waiting else ""
    if why or waiting:
        yield f"  waiting  {'; '.join(filter(None, (waiting, why)))}"
    for node in nodes[:_MOST_NODES]:
        heard = "never heard" if node.heard_ago_s is None else f"{time_words(node.heard_ago_s)} ago"
        trouble = f", {node.trouble}" if node.trouble else ""
        yield f"  node     {node.address} {node.name}: {heard}{trouble}"
    if not nodes:
        yield "  node     nobody was heard yet"
    yield from _more(len(nodes) - _MOST_NODES, "zacoustic nodes")
    yield from _carried_lines(view)
    for stream in failing[:_MOST_STREAMS]:
        yield f"  fails    {stream.name}: {stream.why}"
    yield from _more(len(failing) - _MOST_STREAMS, "zacoustic topic list")
    if not failing:
        yield "  streams  none fails"


def _carried_lines(view: GatewayView) -> Iterator[str]:
    kept = view.carry
    if kept is None:
        return
    shown = kept.streams[:_MOST_STREAMS]
    names = shortened_apart([stream.stream for stream in shown], _TOPIC_LETTERS)
    for stream, name in zip(shown, names, strict=True):
        first, *rest = carried_words(stream, view)
        yield f"  carried  {name}: {first}"
        yield from (f"           {line}" for line in rest)
    yield from _more(len(kept.streams) - _MOST_STREAMS, "zacoustic monitor")
    room = f"{size_words(kept.carried_bytes)} of {size_words(kept.max_bytes)}"
    lost = [
        f"{count} {word}"
        for count, word in ((kept.refused, "refused, no room"), (kept.expired, "expired here"))
        if count
    ]
    if kept.carried or lost:
        yield f"  custody  for others {room}{''.join(f'; {each}' for each in lost)}"


def _more(count: int, verb: str) -> Iterator[str]:
    if count > 0:
        yield f"           and {count} more: {verb}"


def _failing(streams: Sequence[StreamView]) -> Iterator[FailingStream]:
    for stream in streams:
        stopped = stream_words(stream)
        lost = {
            "refused": stream.refused,
            **{word: stream.outcomes.get(word, 0) for word in _UNDELIVERED},
        }
        words = [stopped] if stopped else []
        words += [f"{count} {word}" for word, count in lost.items() if count]
        if words:
            yield FailingStream(
                id=stream.id, name=stream.name, why=", ".join(words), is_stopped=bool(stopped)
            )


def _row(peer: PeerView) -> Sequence[str]:
    signal = (
        number_words(peer.snr_db, "dB")
        if peer.snr_db is not None
        else number_words(peer.received_level_db, "dB")
    )
    return (
        str(peer.address),
        shortened(peer.name, _NAME_LETTERS),
        time_words(peer.heard_ago_s),
        signal,
        range_words(peer).partition(",")[0],
        share_words(peer.per),
        shortened(peer.link or NOTHING, _LINK_LETTERS),
        "LOST" if peer.is_lost else "!" if trouble_words(peer) else "",
    )


def _cut(line: str) -> str:
    return line if len(line) <= _WIDTH else f"{line[: _WIDTH - 1]}…"
