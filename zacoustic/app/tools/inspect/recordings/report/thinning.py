"""Samples that `min_interval_s` leaves out on purpose.

A topic with a least interval sends at most one sample of a key in it. Of those published meanwhile
the newest `depth` wait, and older ones are replaced. They are not lost, and the link was not bad.
Neither are those that still wait when the recording of their publisher ends. Which they are follows
from the times of publication and from the arrivals.
"""

import bisect
import itertools
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from zacoustic.app.tools.inspect.recordings.facts.facts import Facts, Published
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.streams.specs import TopicSpec

# Publishers that keep the interval themselves are early by the jitter of their timers.
_SLACK: Final = 0.02


def left_out(facts: Facts) -> list[Published]:
    """Return the samples that were replaced, or still waited at the end.

    Args:
        facts: The events, already matched, so that arrivals are known.
    """
    keys: dict[tuple[int, int, object], list[Published]] = {}
    for published in facts.published:
        stream = facts.streams[published.stream_id]
        spec = stream.spec
        is_thinned = isinstance(spec, TopicSpec) and stream.qos.min_interval_s > 0
        if is_thinned and not published.delete:
            key = (published.node, published.stream_id, published.instance)
            keys.setdefault(key, []).append(published)
    found: list[Published] = []
    for (node, stream_id, _), samples in keys.items():
        qos = facts.streams[stream_id].qos
        interval_ns = round(qos.min_interval_s * (1 - _SLACK) * NS_PER_S)
        _, ends_ns = facts.spans_ns.get(node, (0, facts.ended_ns))
        slack_ns = round(qos.min_interval_s * _SLACK * NS_PER_S)
        found += _of_key(samples, interval_ns, qos.depth, ends_ns - slack_ns)
    return found


def _of_key(
    samples: Iterable[Published], interval_ns: int, depth: int, ends_ns: int
) -> Iterator[Published]:
    """Yield those of one key; what is due at `ends_ns` or later is not sent any more."""
    waiting: deque[Published] = deque()
    next_ns = 0
    ordered = sorted(samples, key=lambda each: each.at_ns)
    arrived = [each for each in ordered if each.arrived]
    for sample in ordered:
        while waiting and (sent_ns := max(next_ns, waiting[0].at_ns)) <= sample.at_ns:
            first = waiting.popleft()
            if sent_ns >= ends_ns and not first.arrived:
                yield first
            elif first.arrived or not _is_overtaken(first, sent_ns + interval_ns, arrived):
                next_ns = sent_ns + interval_ns
            else:  # the channel was busy when it was due, and a newer one replaced it
                yield first
        waiting.append(sample)
        if len(waiting) > depth:
            oldest = waiting.popleft()
            if not oldest.arrived:
                yield oldest
    for sample in waiting:
        sent_ns = max(next_ns, sample.at_ns)
        next_ns = sent_ns + interval_ns
        if sent_ns >= ends_ns and not sample.arrived:
            yield sample


def _is_overtaken(sample: Published, until_ns: int, arrived: Sequence[Published]) -> bool:
    """Tell whether a newer sample arrived so soon that this one cannot have been sent before."""
    place = bisect.bisect_right(arrived, sample.at_ns, key=lambda each: each.at_ns)
    soon = itertools.takewhile(lambda each: each.at_ns < until_ns, arrived[place:])
    return any(min(each.arrived.values()) < until_ns for each in soon)
