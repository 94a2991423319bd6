"""Numbers of a view as short words, the same on terminal and page."""

from collections.abc import Sequence
from typing import Final

from msgspec import UNSET

from zacoustic.app.tools.pages.truth import Alarm
from zacoustic.app.tools.watch.views import (
    FrameView,
    GatewayView,
    LinkView,
    PeerView,
    StreamView,
    TransferView,
    WaitsView,
)

NOTHING: Final = "–"
"""Text for unknown values."""
_MOST_NAMED: Final = 4
"""Most failed gateways to name."""
LOSING: Final = 0.2
"""A packet error rate above this gets a colour."""
LOST_OUTCOMES: Final = ("not_delivered", "rejected", "aborted")
"""A modem's outcomes of undelivered frames."""
OLD_S: Final = 120.0
"""A node not heard for longer than this gets a colour, s."""

_SILENT: Final = "SILENT by order or by a quiet window"
_MINUTE_S: Final = 60
_HOUR_S: Final = 3600
_DAY_S: Final = 86_400


def time_words(seconds: float | None) -> str:
    """Return a time with its unit: ``0.4 s``, ``12 s``, ``5 min``, ``3.1 h``, ``2.0 d``."""
    if seconds is None:
        return NOTHING
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 2 * _MINUTE_S:
        return f"{seconds:.0f} s"
    if seconds < 2 * _HOUR_S:
        return f"{seconds / _MINUTE_S:.0f} min"
    if seconds < 2 * _DAY_S:
        return f"{seconds / _HOUR_S:.1f} h"
    return f"{seconds / _DAY_S:.1f} d"


def rate_words(hz: float | None) -> str:
    """Return a rate with a suitable unit: ``2.0/s``, ``12/min``."""
    if hz is None:
        return NOTHING
    for unit, seconds in (("s", 1), ("min", _MINUTE_S)):
        if hz * seconds >= 1:
            return f"{_two_digits(hz * seconds)}/{unit}"
    return f"{_two_digits(hz * _HOUR_S)}/h"


def _two_digits(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def size_words(size_bytes: int | None) -> str:
    """Return a size: ``812 B``, ``4.2 kB``."""
    if size_bytes is None:
        return NOTHING
    if size_bytes < 10_000:
        return f"{size_bytes} B"
    if size_bytes < 10_000_000:
        return f"{size_bytes / 1e3:.1f} kB"
    return f"{size_bytes / 1e6:.1f} MB"


def share_words(share: float | None) -> str:
    """Return a share, 0…1, in percent."""
    return NOTHING if share is None else f"{share * 100:.1f} %"


def number_words(value: float | None, unit: str, digits: int = 1) -> str:
    """Return a number with its unit."""
    return NOTHING if value is None else f"{value:.{digits}f} {unit}"


def title_words(view: GatewayView) -> str:
    """Return a gateway's name and address."""
    return f"{view.address} {view.name}".rstrip()


def state_words(view: GatewayView) -> str:
    """Return the state in a few words, with what prevents transmission first."""
    if not view.is_alive:
        return "gone: it does not answer on this network"
    words = [f"link {view.whole.state}"]
    if view.whole.detail:
        words.append(view.whole.detail)
    if view.whole.is_silent:
        words.append(f"SILENT: {view.whole.why_silent}" if view.whole.why_silent else _SILENT)
    if view.is_shared:
        words.append(f"ANOTHER NODE has address {view.address} too")
    if view.journal not in ("kept", "none"):
        words.append(f"journal fails: {view.journal}")
    if view.doubt:
        words.append(f"journal in doubt: {view.doubt}")
    return ", ".join(words)


def alarm_of(views: Sequence[GatewayView], trouble: str) -> Alarm | None:
    """Return the failure to show; None: none.

    Args:
        views: The gateways.
        trouble: Why none of them can be reached; empty: no reason known.
    """
    if trouble:
        return Alarm(f"NOT CURRENT: {trouble}")
    gone = [view for view in views if not view.is_alive]
    down = [view for view in views if view.is_alive and view.whole.state != "up"]
    words = [f"gateway {title_words(view)} gone" for view in gone]
    words += [f"link of gateway {title_words(view)} {view.whole.state}" for view in down]
    if not words:
        return None
    if len(words) > _MOST_NAMED:
        words[_MOST_NAMED:] = [f"and {len(words) - _MOST_NAMED} more"]
    since_s = gone[0].gone_s if len(words) == 1 and gone else None
    return Alarm(f"NOT CURRENT: {', '.join(words)}", since_s)


def troubled_first(streams: Sequence[StreamView]) -> list[StreamView]:
    """Return streams in order: those with faults, those with losses, the others."""

    def rank(stream: StreamView) -> tuple[bool, bool]:
        return not stream_words(stream), not (stream.refused or stream.expired)

    return sorted(streams, key=rank)


def is_well(view: GatewayView) -> bool:
    """Tell whether nothing prevents transmission."""
    link = view.whole
    transmits = view.is_alive and link.state == "up" and not link.is_silent
    return transmits and not view.is_shared and view.journal in ("kept", "none")


def waits_words(waits: WaitsView | None) -> str:
    """Return why the next frame of a link waits, and for how long; empty: nothing waits."""
    if waits is None:
        return ""
    left = "" if waits.left_s is None else f", {time_words(waits.left_s)} more"
    return f"next frame waits: {waits.why}{left}"


def capability_words(link: LinkView) -> str:
    """Return the largest frame and the bit rate of a link; empty: it has not opened yet."""
    can = link.capabilities
    return "" if can is None else f"{can.mtu_bytes} B at {can.bit_rate_bps:.0f} bit/s"


def link_cells(link: LinkView) -> tuple[str, ...]:
    """Return what a table says of a link: name, state, frames sent, heard, airtime."""
    state = ", ".join(filter(None, (link.state, link.detail, waits_words(link.waits))))
    paid = "" if link.paid is UNSET else f", {link.paid:.2f} paid"
    airtime = f"{link.airtime_s:.1f} s{paid}"
    return link.name or "link", state, str(link.frames_sent), str(link.frames_heard), airtime


def load_words(view: GatewayView) -> str:
    """Return the utilisation in words."""
    if view.utilisation is None:
        return NOTHING
    return f"{share_words(view.utilisation)} of the last {time_words(view.window_s)}"


def signal_words(peer: PeerView) -> str:
    """Return what the modem measured of a node's signal."""
    words = [
        number_words(value, unit, digits)
        for value, unit, digits in (
            (peer.snr_db, "dB SNR", 1),
            (peer.received_level_db, "dB", 1),
            (peer.integrity, "integrity", 0),
        )
        if value is not None
    ]
    return ", ".join(words) or NOTHING


def range_words(peer: PeerView) -> str:
    """Return the range of a node, and the age of the measurement."""
    if peer.range_m is not None:
        return f"{peer.range_m:.0f} m, {time_words(peer.range_ago_s)} ago"
    if peer.propagation_s is not None:
        return f"{peer.propagation_s:.3f} s, {time_words(peer.range_ago_s)} ago"
    return NOTHING


def error_words(peer: PeerView) -> str:
    """Return the packet error rate, and its number of frames."""
    return NOTHING if peer.per is None else f"{share_words(peer.per)} of {peer.exchanges}"


def peer_cells(peer: PeerView) -> tuple[str, ...]:
    """Return what a table says of a node: name, when heard, range, signal, frames lost, fault."""
    heard = "never" if peer.heard_ago_s is None else f"{time_words(peer.heard_ago_s)} ago"
    node = f"{peer.address} {peer.name}".rstrip()
    signal, lost = signal_words(peer), error_words(peer)
    return node, heard, range_words(peer), signal, lost, trouble_words(peer)


def trouble_words(peer: PeerView) -> str:
    """Return the fault of a node; empty: none."""
    words = ["LOST"] if peer.is_lost else []
    words += ["TWO NODES with this address"] if peer.is_shared else []
    words += ["another table"] if peer.same_table is False else []
    words += [f"late: {', '.join(peer.late)}"] if peer.late else []
    return ", ".join(words)


def stream_words(stream: StreamView) -> str:
    """Return the fault of a stream; empty: none."""
    words = []
    if stream.differs_at:
        words.append(f"differs at {', '.join(map(str, stream.differs_at))}: stopped")
    if stream.deadline_missed:
        words.append(f"late {stream.deadline_missed} times")
    return ", ".join(words)


def stream_cells(stream: StreamView) -> tuple[str, ...]:
    """Return what a table says of a stream; empty for what has not happened.

    That is how often it was sent, the time since, its rate, the same of what was heard, its age,
    what waits, its share of the airtime, and its fault.
    """
    crossed = [
        (str(times), time_words(ago_s), rate_words(hz)) if times or ago_s is not None else ("",) * 3
        for times, ago_s, hz in (
            (stream.sent, stream.sent_ago_s, stream.sent_rate_hz),
            (stream.heard, stream.heard_ago_s, stream.heard_rate_hz),
        )
    ]
    age = "" if stream.age_s is None else time_words(stream.age_s)
    waiting = str(stream.waiting or "")
    airtime = share_words(stream.airtime_share) if stream.airtime_bytes else ""
    return *crossed[0], *crossed[1], age, waiting, airtime, stream_words(stream)


def frame_words(frame: FrameView) -> str:
    """Return direction, other node and contents of a frame."""
    peer = "all" if frame.peer is None else str(frame.peer)
    where = f"→ {peer}" if frame.way == "out" else f"← {'?' if frame.peer is None else peer}"
    return f"{where}: {', '.join(frame.streams) or 'acknowledgements and the like'}"


def frame_cells(frame: FrameView, outcome: str = "") -> tuple[str, ...]:
    """Return what a table says of a frame: contents, bytes, airtime, age, outcome.

    Args:
        frame: The frame.
        outcome: What stands for its outcome; empty: what its modem has reported.
    """
    return (
        frame_words(frame),
        str(frame.size_bytes),
        f"{frame.airtime_s:.2f} s",
        time_words(frame.ago_s),
        outcome or frame.outcome.replace("_", " "),
    )


def now_words(view: GatewayView) -> str:
    """Return the frame being sent now; empty: none."""
    frame = view.transmitting
    return "" if frame is None else f"sending {frame.size_bytes} B {frame_words(frame)}"


def is_quiet(stream: StreamView) -> bool:
    """Tell whether nothing of a stream has crossed, waits or is wrong."""
    has_crossed = stream.sent or stream.heard or stream.published or stream.airtime_bytes
    return not (has_crossed or stream.waiting or stream_words(stream))


def transfer_words(transfer: TransferView) -> str:
    """Return the name of a large sample, with its outcome or progress."""
    peer = "all" if transfer.peer is None else str(transfer.peer)
    head = f"{transfer.stream or 'beginning'} {transfer.direction} {peer}"
    if transfer.outcome is not None:
        return f"{head}: {transfer.outcome}, {size_words(transfer.total_bytes)}"
    sent = "" if transfer.sent_bytes is None else f", {size_words(transfer.sent_bytes)} sent"
    done = f"{size_words(transfer.done_bytes)} of {size_words(transfer.total_bytes)}"
    return f"{head}: {done} there{sent}"
