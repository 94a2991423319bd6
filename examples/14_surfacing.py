"""A vehicle that surfaces every ten minutes: its streams go by radio there, and by sound below.

Run it: python examples/14_surfacing.py
"""

from collections.abc import Sequence
from functools import partial

from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing import Modem, VirtualNetwork

SHORE, AUV = 1, 2
NAV = 1
PERIOD_S, SURFACED_S = 600.0, 120.0


def is_surfaced(now_s: float) -> bool:
    """Return whether the vehicle is at the surface."""
    return now_s % PERIOD_S < SURFACED_S


def by_radio(source: int, node: int, now: int) -> Sequence[float]:
    """Return when a datagram arrives, s after it was due: not at all below the surface."""
    return (0.0,) if is_surfaced(now / NS_PER_S) else ()


def network() -> VirtualNetwork:
    """Return shore and vehicle, 1500 m apart."""
    table = StreamTable(
        [TopicSpec(stream_id=NAV, name="auv/nav", publishers=(AUV,), subscribers=(SHORE,))],
        nodes={SHORE: "shore", AUV: "auv"},
    )
    nodes = tuple(
        NodeSpec(address=each, position=(1500.0 * each, 0.0, 10.0)) for each in table.nodes
    )
    links = Bond(number=31, links=("radio", "sound"))
    rules = TransmitRules(
        links=(
            LinkRules(name="sound"),
            LinkRules(name="radio", bonded=BondLink(cost=LinkCost.FREE)),
        ),
        bonds=(links,),
        default_link=links.name,
    )
    joined = VirtualNetwork(Scenario(nodes=nodes), table, seed=1, rules=rules)
    # The medium of datagrams is as slow as sound, so they get a twentieth of a second.
    aerials = tuple(
        NodeSpec(address=each, position=(75.0 * each, 0.0, 0.0)) for each in table.nodes
    )
    joined.add_link(
        "radio",
        Scenario(nodes=aerials, profile="ideal", channel="none"),
        modem=Modem(addressed=False, checked=False, senses_carrier=False),
        disturb=by_radio,
    )
    return joined


def main() -> None:
    """Let two hours pass, with a report every 20 seconds."""
    joined = network()
    for number in range(360):
        joined.at(20.0 * number + 5.0, partial(joined.publish, AUV, NAV, b"%d" % number))
    joined.run(until_s=7300.0)
    delays_s: dict[bool, list[float]] = {True: [], False: []}
    for sample in joined.samples(SHORE, NAV):
        given_s = 20.0 * int(bytes(sample.value)) + 5.0
        delays_s[is_surfaced(given_s)].append(sample.received_at / NS_PER_S - given_s)
    for surfaced, where in ((True, "at the surface"), (False, "below")):
        median_s = sorted(delays_s[surfaced])[len(delays_s[surfaced]) // 2]
        print(f"{where}: {len(delays_s[surfaced])} reports, {median_s:.2f} s in the middle")
    (status,) = joined.engine(AUV).bonds
    print(f"in use now: {status.in_use}; {status.again} frames went again by the next link")
    assert len(delays_s[True]) >= 70


if __name__ == "__main__":
    main()
