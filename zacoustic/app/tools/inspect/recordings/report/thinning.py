"""Samples that `min_interval_s` leaves out on purpose.

A topic with a least interval sends at most one sample of a key in it. Of those published meanwhile
the newest `depth` wait, and older ones are replaced. They are not lost, and the link was not bad.
Neither are those that still wait when the recording of their publisher ends. Which they are follows
from the times of publication and from the arrivals.
"""

import itertools
import struct
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Final

from zacoustic.app.tools.inspect.recordings.facts.facts import Facts
from zacoustic.app.tools.inspect.recordings.facts.rows import Row, in_order
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.streams.specs import TopicSpec

# Publishers that keep the interval themselves are early by the jitter of their timers.
_SLACK: Final = 0.02

_NEVER: Final = -1 << 63


class _Sample(Row, frozen=True):
    """A published sample of a thinned topic, or its arrival; those of a key together, by time."""

    layout = struct.Struct("<12sBIqQq")
    place: bytes
    node: int
    stream_id: int
    at_ns: int
    number: int
    arrived_ns: int
    """UTC, ns; `_NEVER` in the row of the publication, which is before its arrivals."""


def left_out(facts: Facts) -> Iterator[tuple[int, int]]:
    """Yield publisher and stream of the samples that were replaced, or still waited at the end.

    Args:
        facts: The events, already matched, so that arrivals are known.
    """
    thinned = {
        stream_id
        for stream_id, stream in facts.streams.items()
        if isinstance(stream.spec, TopicSpec) and stream.qos.min_interval_s > 0
    }
    published = (
        _Sample(each.place, each.node, each.stream_id, each.at_ns, each.number, _NEVER)
        for each in facts.samples
        if each.stream_id in thinned and not each.is_arrival
    )
    arrived = (
        _Sample(each.place, each.source, each.stream_id, each.begun_ns, each.number, each.at_ns)
        for each in facts.deliveries
        if each.stream_id in thinned
    )
    ordered = in_order(_Sample, itertools.chain(published, arrived) if thinned else ())
    of_keys = itertools.groupby(ordered, lambda each: (each.place, each.node, each.stream_id))
    for (_, node, stream_id), samples in of_keys:
        qos = facts.streams[stream_id].qos
        interval_ns = round(qos.min_interval_s * (1 - _SLACK) * NS_PER_S)
        _, ends_ns = facts.spans_ns.get(node, (0, facts.ended_ns))
        slack_ns = round(qos.min_interval_s * _SLACK * NS_PER_S)
        for _ in _of_key(_once_each(samples), interval_ns, qos.depth, ends_ns - slack_ns):
            yield node, stream_id


def _once_each(rows: Iterable[_Sample]) -> Iterator[_Sample]:
    """Yield each sample once, with its first arrival."""
    for _, told in itertools.groupby(rows, lambda each: each.number):
        published, *arrivals = told
        yield arrivals[0] if arrivals else published


def _of_key(
    samples: Iterable[_Sample], interval_ns: int, depth: int, ends_ns: int
) -> Iterator[_Sample]:
    """Yield those of one key; what is due at `ends_ns` or later is not sent any more."""
    waiting: deque[_Sample] = deque()
    next_ns = 0
    ordered, ahead = itertools.tee(samples)
    soon: deque[_Sample] = deque()

    def is_overtaken(sample: _Sample, until_ns: int) -> bool:
        """Tell whether a newer one arrived so soon that this one cannot have been sent before."""
        while not soon or soon[-1].at_ns < until_ns:
            if (following := next(ahead, None)) is None:
                break
            soon.append(following)
        while soon and soon[0].at_ns <= sample.at_ns:
            soon.popleft()
        return any(_NEVER < each.arrived_ns < until_ns for each in soon)

    for sample in ordered:
        while waiting and (sent_ns := max(next_ns, waiting[0].at_ns)) <= sample.at_ns:
            first = waiting.popleft()
            if sent_ns >= ends_ns and not _has_arrived(first):
                yield first
            elif not is_overtaken(first, sent_ns + interval_ns) or _has_arrived(first):
                next_ns = sent_ns + interval_ns
            else:  # the channel was busy when it was due, and a newer one replaced it
                yield first
        waiting.append(sample)
        if len(waiting) > depth:
            oldest = waiting.popleft()
            if not _has_arrived(oldest):
                yield oldest
    for sample in waiting:
        sent_ns = max(next_ns, sample.at_ns)
        next_ns = sent_ns + interval_ns
        if sent_ns >= ends_ns and not _has_arrived(sample):
            yield sample


def _has_arrived(sample: _Sample) -> bool:
    return sample.arrived_ns != _NEVER
