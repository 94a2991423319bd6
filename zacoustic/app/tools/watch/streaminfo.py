"""One stream: what the file defines of it, and what gateways count."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.watch.views import GatewayView, StreamView
from zacoustic.app.tools.watch.words import (
    rate_words,
    share_words,
    size_words,
    stream_words,
    time_words,
    title_words,
)
from zacoustic.config import Config
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.text.safetext import one_line

_COLUMN: Final = 13


class Definition(msgspec.Struct, frozen=True, kw_only=True):
    """What the file says of a stream."""

    type: str | None
    """Type of its samples, requests or goals; None: opaque bytes."""
    fields: tuple[str, ...]
    """Names of the type's fields."""
    encoding: str
    """Zenoh encoding on the application side."""
    codec: str
    """Codec on the channel."""
    publishers: tuple[str, ...]
    """Names or addresses of who publishes or serves; empty: anybody."""
    subscribers: tuple[str, ...]
    """Names or addresses of who subscribes; empty: all."""
    reliability: str
    """``best_effort`` or ``reliable``."""
    priority: str
    """Zenoh's priority."""
    depth: int
    """Samples of a key that may wait."""
    lifespan_s: float | None
    """Largest age of a sample, s; None: any."""
    min_interval_s: float
    """Least time between two samples of a key, s."""


def stream_in(streams: Iterable[StreamView], called: str) -> StreamView | None:
    """Return the stream with a name or an id, or None."""
    return next((each for each in streams if called in (each.name, str(each.id))), None)


def definition_of(config: Config, stream_id: int) -> Definition | None:
    """Return what a file says of a stream; None: it has no such stream."""
    stream = config.table.get(stream_id)
    if stream is None:
        return None
    spec, qos = stream.spec, stream.qos
    if isinstance(spec, TopicSpec):
        publishers, subscribers = spec.publishers or (), spec.subscribers or ()
    else:
        publishers, subscribers = (spec.server,), ()
    return Definition(
        type=None if stream.type is None else stream.type.name,
        fields=() if stream.type is None else tuple(each.name for each in stream.type.fields),
        encoding=stream.encoding,
        codec=spec.codec,
        publishers=tuple(_named(config, publishers)),
        subscribers=tuple(_named(config, subscribers)),
        reliability=qos.reliability.name.lower(),
        priority=qos.priority.name.lower(),
        depth=qos.depth,
        lifespan_s=qos.lifespan_s,
        min_interval_s=qos.min_interval_s,
    )


def info_text(
    found: Sequence[tuple[GatewayView, StreamView]], definition: Definition | None
) -> str:
    """Return a stream in lines for people.

    Args:
        found: The gateways that have it, with their counts.
        definition: What the file says of it; None: there is no file.
    """
    stream = found[0][1]
    lines = [f"{stream.name} (stream {stream.id}, {stream.kind})"]
    if definition is not None:
        lines += [f"  {name:<{_COLUMN}}{text}" for name, text in _defined(definition)]
    for view, each in found:
        lines += [f"  {name:<{_COLUMN}}{text}" for name, text in _counted(view, each)]
    return "\n".join(map(one_line, lines))


def _named(config: Config, addresses: Iterable[int]) -> Iterator[str]:
    for address in addresses:
        yield f"{address} {config.nodes.get(address, '')}".rstrip()


def _defined(definition: Definition) -> Iterator[tuple[str, str]]:
    fields = f": {', '.join(definition.fields)}" if definition.fields else ""
    yield "type", f"{definition.type or 'bytes'}{fields}"
    yield "encoding", f"{definition.encoding}, {definition.codec} on the channel"
    yield "publishers", ", ".join(definition.publishers) or "anybody"
    yield "subscribers", ", ".join(definition.subscribers) or "all"
    interval = (
        f", every {definition.min_interval_s:g} s at most" if definition.min_interval_s else ""
    )
    life = "" if definition.lifespan_s is None else f", at most {definition.lifespan_s:g} s old"
    yield "delivery", f"{definition.reliability}, depth {definition.depth}{life}{interval}"
    yield "priority", definition.priority


def _counted(view: GatewayView, stream: StreamView) -> Iterator[tuple[str, str]]:
    yield "gateway", title_words(view)
    for way, count, ago_s, rate_hz in (
        ("sent", stream.sent, stream.sent_ago_s, stream.sent_rate_hz),
        ("heard", stream.heard, stream.heard_ago_s, stream.heard_rate_hz),
    ):
        if count:
            yield f"  {way}", f"{count}, last {time_words(ago_s)} ago, {rate_words(rate_hz)}"
    if stream.age_s is not None:
        yield "  age", time_words(stream.age_s)
    if stream.waiting:
        yield "  waiting", str(stream.waiting)
    if stream.airtime_bytes:
        share = f"{share_words(stream.airtime_share)} of the gateway's airtime"
        yield "  on the air", f"{size_words(stream.airtime_bytes)}, {share}"
    outcomes = ", ".join(f"{count} {word}" for word, count in stream.outcomes.items() if count)
    if outcomes:
        yield "  outcomes", outcomes
    if words := stream_words(stream):
        yield "  FAILS", words
