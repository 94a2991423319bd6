"""The counters of a node: whatever goes inside other frames, each frame of a modem counts once.

The reference is the trace of what the modems were given, and what they reported and handed over.
"""

from collections import Counter
from functools import partial
from typing import Final

import pytest

from tests.virtual.twolinks import ARM, BESIDE, FIX, LINKS, MOVE, PLAN, RADIO, SOUND, TwoLinks
from zacoustic.core.bond.spec import Bond
from zacoustic.core.engine.tap import EngineCall, Tap
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.relay.route import Route

LINES: Final = {
    "links": "",
    "bond": "radio+sound",
    "route": "far",
    "bond of a route": "far+radio",
    "flood": FLOOD_NAME,
}
"""The link of half of the streams."""
NODES: Final = (1, 2, 3)


def rules(line: str) -> TransmitRules:
    streams = dict.fromkeys((FIX, PLAN, ARM, MOVE), SOUND)
    streams |= {each + BESIDE: LINES[line] or RADIO for each in (FIX, PLAN, ARM, MOVE)}
    bond = LINES[line].split("+")
    return TransmitRules(
        links=tuple(LinkRules(name=each) for each in LINKS),
        routes=(Route(route_id=1, name="far", path=(2, 3, 1), link=SOUND),),
        bonds=(Bond(number=31, links=tuple(bond)),) if len(bond) > 1 else (),
        flood=Flood(link=SOUND),
        links_of_streams=streams,
    )


@pytest.mark.parametrize("line", LINES)
def test_sums_of_links_and_ledger_are_what_the_modems_had(line: str) -> None:
    two = TwoLinks(3, loss=(0.1, 0.1), rules=rules(line))
    heard: Counter[tuple[int, str]] = Counter()

    def hear(node: int, call: EngineCall) -> None:
        heard[node, call.arguments.get("link") or SOUND] += 1

    for node in NODES:
        Tap(two.network.engine(node), partial(hear, node), ["handle_frame"])
    for number in range(4):
        two.network.at(20.0 + 300.0 * number, partial(two.use_all, b"%d" % number, b"photo" * 30))
    two.network.run(until_s=3000.0)
    for node in NODES:
        stats = two.network.engine(node).stats
        frames = {link: [each for at, _, each in two.sent(link) if at == node] for link in LINKS}
        sent = [each for of_link in frames.values() for each in of_link]
        assert stats.frames_transmitted == len(sent) > 10
        assert stats.bytes_transmitted == sum(map(len, sent))
        assert stats.bytes_transmitted == sum(each.transmitted_bytes for each in stats.ledger())
        assert stats.airtime_ns == sum(stats.links[each].airtime_ns for each in LINKS)
        assert sum(stats.reports.values()) == len(sent)
        for link in LINKS:
            of_link = stats.links[link]
            assert of_link.frames_transmitted == len(frames[link])
            assert of_link.bytes_transmitted == sum(map(len, frames[link]))
            assert of_link.frames_received == heard[node, link]
        assert stats.frames_received == sum(heard[node, link] for link in LINKS)
