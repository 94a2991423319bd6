"""A gateway in ten lines: link, load, nodes, and the streams that fail; a table of nodes."""

from collections.abc import Iterator, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.columns import align, shortened, shortened_apart
from zacoustic.app.tools.watch.views import (
    CarryView,
    GatewayView,
    PeerView,
    StreamView,
    WaitsView,
)
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


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """The state of one gateway, shortened."""

    address: int
    """Acoustic address."""
    name: str
    """Name in the table."""
    is_well: bool
    """The link is up and transmits, the journal is kept, and no stream is stopped."""
    state: str
    """State of the link in words."""
    link: str
    """Locator of the modem."""
    uptime_s: float | None
    """Time since the start, s."""
    utilisation: float | None
    """Share of the time on the air, 0…1; None: unknown yet."""
    frames_sent: int
    """Frames sent."""
    frames_heard: int
    """Received frames."""
    frames_damaged: int
    """Damaged ones among them."""
    waiting: int
    """Waiting samples, calls and goals."""
    waits: WaitsView | None
    """Why the next frame waits; None: nothing waits."""
    nodes: tuple[HeardNode, ...]
    """The other nodes, the last heard first."""
    carry: CarryView | None
    """What it keeps of carried topics; None: it takes no part in any."""
    failing: tuple[FailingStream, ...]
    """The streams that fail, stopped ones first."""


def status_of(view: GatewayView) -> Status:
    """Return the status of a gateway."""
    failing = sorted(_failing(view.streams), key=lambda each: not each.is_stopped)
    never = float("inf")
    peers = sorted(
        view.peers, key=lambda peer: never if peer.heard_ago_s is None else peer.heard_ago_s
    )
    return Status(
        address=view.address,
        name=view.name,
        is_well=is_well(view) and not any(each.is_stopped for each in failing),
        state=state_words(view),
        link=view.link,
        uptime_s=view.uptime_s,
        utilisation=view.utilisation,
        frames_sent=view.frames_sent,
        frames_heard=view.frames_heard,
        frames_damaged=view.frames_damaged,
        waiting=view.waiting,
        waits=view.waits,
        nodes=tuple(
            HeardNode(
                address=peer.address,
                name=peer.name,
                heard_ago_s=peer.heard_ago_s,
                trouble=trouble_words(peer),
            )
            for peer in peers
        ),
        carry=view.carry,
        failing=tuple(failing),
    )


def status_text(view: GatewayView) -> str:
    """Return a gateway in about ten lines."""
    status = status_of(view)
    return "\n".join(_cut(one_line(line)) for line in _lines(view, status))


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


def _lines(view: GatewayView, status: Status) -> Iterator[str]:
    yield f"gateway {title_words(view)}: {status.state}"
    runs = f"the gateway runs for {time_words(status.uptime_s)}"
    yield f"  link     {status.link or NOTHING}: {view.link_state}; {runs}"
    damaged = f" ({status.frames_damaged} damaged)" if status.frames_damaged else ""
    counts = f"{status.frames_sent} frames sent, {status.frames_heard} heard{damaged}"
    yield f"  on air   {load_words(view)}; {counts}"
    why = waits_words(status.waits)
    waiting = f"{status.waiting} samples, calls and goals" if status.waiting else ""
    if why or waiting:
        yield f"  waiting  {'; '.join(filter(None, (waiting, why)))}"
    for node in status.nodes[:_MOST_NODES]:
        heard = "never heard" if node.heard_ago_s is None else f"{time_words(node.heard_ago_s)} ago"
        trouble = f", {node.trouble}" if node.trouble else ""
        yield f"  node     {node.address} {node.name}: {heard}{trouble}"
    if not status.nodes:
        yield "  node     nobody was heard yet"
    yield from _more(len(status.nodes) - _MOST_NODES, "zacoustic nodes")
    yield from _carried_lines(view)
    for stream in status.failing[:_MOST_STREAMS]:
        yield f"  fails    {stream.name}: {stream.why}"
    yield from _more(len(status.failing) - _MOST_STREAMS, "zacoustic topic list")
    if not status.failing:
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
