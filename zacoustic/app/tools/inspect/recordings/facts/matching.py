"""Finds the publication of each received sample, if its publisher is recorded.

It is the newest publication of the same value that the receiver has not received yet, which is
exact as long as values differ. Samples with the same key and value stand together in the order of
`Sample`, by time. For each receiver the publications go on a stack, and an arrival takes the top.
"""

import itertools
from array import array

from zacoustic.app.tools.inspect.recordings.facts.facts import Delivery, Facts, Sample
from zacoustic.app.tools.inspect.recordings.facts.rows import Rows, in_order


def match(facts: Facts) -> None:
    """Find the deliveries anew."""
    facts.deliveries = Rows(Delivery)
    ordered = in_order(Sample, facts.samples)
    for _, samples in itertools.groupby(ordered, lambda each: (each.place, each.content)):
        waiting: dict[int, array[int]] = {}
        for sample in samples:
            if not waiting:
                receivers = facts.counts[sample.stream_id].receivers
                # The number and the instant of each publication, one after the other.
                waiting = {node: array("q") for node in receivers}
            if not sample.is_arrival:
                for stack in waiting.values():
                    stack.extend((sample.number, sample.at_ns))
            elif stack := waiting[sample.node]:
                begun_ns, number = stack.pop(), stack.pop()
                whose = sample.stream_id, begun_ns, sample.source, sample.place
                facts.deliveries.append(Delivery(number, sample.at_ns, sample.number, *whose))
