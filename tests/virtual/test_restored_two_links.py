"""An old copy of the journal of a node with two links, put back: nothing is acted on twice."""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial

import pytest

from tests.virtual.twolinks import ARM, BESIDE, KEPT, MOVE, PLAN, RADIO, TwoLinks
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import JournalDoubted, SampleReceived

BACKUP = "it was put back from a backup"
"""What the store says; empty: it has not found out. A server must know, to run nothing twice."""
PHOTO = random.Random(7).randbytes(900)


def put_back(fleet: TwoLinks, node: int, entries: dict[str, bytes], doubt: str) -> None:
    fleet.network.crash(node)
    fleet.network.journal(node).put_back(entries, doubt)
    fleet.network.start(node)


@pytest.mark.parametrize(("node", "doubt"), [(1, BACKUP), (2, BACKUP), (2, "")])
def test_an_old_copy_is_overcome_on_both_links(
    count: Callable[[int], int], node: int, doubt: str
) -> None:
    """Node 1 receives, and serves calls and goals; node 2 publishes and asks."""
    for seed in range(count(200)):
        _restore(seed, node, doubt)


def test_samples_without_a_position_in_the_frame_of_one_with_it_are_marked_as_well() -> None:
    """Behind the first SYNC of a life in doubt its frame had two samples of the former life."""
    _restore(15, 1, BACKUP)


def _restore(seed: int, node: int, doubt: str) -> None:
    rng = random.Random(seed)
    fleet = TwoLinks(3, loss=(0.2, 0.2), seed=seed)
    network = fleet.network
    tags = [b"%d" % number for number in range(6)]
    for tag in tags:
        network.at(rng.uniform(1, 300), partial(fleet.use_all, tag, PHOTO))
    network.run(until_s=rng.uniform(20, 250))
    entries = dict(network.journal(node).entries)
    network.run(until_s=320.0)
    put_back(fleet, node, entries, doubt)
    network.run(until_s=3 * 3600.0)
    fleet.use_all(b"new", PHOTO)
    network.run(until_s=6 * 3600.0)
    assert bool(fleet.told(node, JournalDoubted)) or not doubt, seed
    asked = {key: times for key, times in fleet.served.items() if times > 1}
    assert not asked, (seed, asked)
    for first in (0, BESIDE):
        for receiver in (1, 3):
            for stream_id, words in ((PLAN, (b"plan", PHOTO)), (KEPT, (b"kept",))):
                samples = fleet.told(receiver, SampleReceived)
                got = [each for each in samples if each.stream_id == first + stream_id]
                unmarked = Counter(each.value for each in got if not each.again)
                assert set(unmarked.values()) <= {1}, (seed, receiver, stream_id)
                # In doubt whether it had them before, a receiver marks those of this life.
                values = Counter(each.value for each in got)
                assert [values[word + b"new"] for word in words] == [1] * len(words), seed
        for stream_id, word in ((ARM, b"arm"), (MOVE, b"move")):
            assert fleet.served[first + stream_id, word + b"new"] == 1, seed
    for each in network.addresses:
        assert network.engine(each).is_idle, (seed, each)


def test_the_copy_has_entries_of_both_links() -> None:
    fleet = TwoLinks(loss=(0.0, 0.0))
    fleet.use_all(b"1", PHOTO)
    fleet.network.run(until_s=2.0)
    keys = fleet.network.journal(2).entries
    assert any(key.startswith(f"@{RADIO}/") for key in keys)
    assert any(not key.startswith("@") for key in keys)
    assert fleet.network.now == 2 * NS_PER_S
