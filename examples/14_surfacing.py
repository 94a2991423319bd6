"""A vehicle that surfaces every ten minutes: its streams go by radio there, and by sound below.

In the third hour it is far out, where neither is heard: from there they go by satellite, whenever
it surfaces. 14_surfacing_processes.py has the same with processes.

Run it: python examples/14_surfacing.py
"""

from collections.abc import Sequence
from functools import partial

from zacoustic.core.clock import NS_PER_S
from zacoustic.testing import (
    Bond,
    BondLink,
    ContactRules,
    LinkCost,
    LinkRules,
    Modem,
    NodeSpec,
    Scenario,
    StreamTable,
    TopicSpec,
    TransmitRules,
    VirtualNetwork,
)

SHORE, AUV = 1, 2
NAV = 1
PERIOD_S, SURFACED_S = 600.0, 120.0
LEAVES_S = 7200.0


def is_surfaced(now_s: float) -> bool:
    """Return whether the vehicle is at the surface."""
    return now_s % PERIOD_S < SURFACED_S


def by_radio(source: int, node: int, now: int) -> Sequence[float]:
    """Return when a datagram arrives, s after it was due: not at all below the surface."""
    now_s = now / NS_PER_S
    return (0.0,) if is_surfaced(now_s) and now_s < LEAVES_S else ()


def by_sound(source: int, node: int, now: int) -> Sequence[float]:
    """Return when a frame arrives, s after it was due: not at all from far out."""
    return (0.0,) if now / NS_PER_S < LEAVES_S else ()


def by_satellite(source: int, node: int, now: int) -> Sequence[float]:
    """Return when a message arrives, s after it was due: its session takes 20 s, at the surface."""
    return (20.0,) if is_surfaced(now / NS_PER_S) else ()


def network() -> VirtualNetwork:
    """Return shore and vehicle, 1500 m apart."""
    table = StreamTable(
        [TopicSpec(stream_id=NAV, name="auv/nav", publishers=(AUV,), subscribers=(SHORE,))],
        nodes={SHORE: "shore", AUV: "auv"},
    )
    nodes = tuple(
        NodeSpec(address=each, position=(1500.0 * each, 0.0, 10.0)) for each in table.nodes
    )
    links = Bond(number=31, links=("radio", "sound", "satellite"))
    rules = TransmitRules(
        links=(
            LinkRules(name="sound"),
            LinkRules(name="radio", bonded=BondLink(cost=LinkCost.FREE)),
            LinkRules(name="satellite", bonded=BondLink(cost=LinkCost.MONEY)),
        ),
        # Nobody answers a sample, so without these the vehicle would think that sound is gone.
        contact=ContactRules(heartbeat_s=240.0),
        bonds=(links,),
        default_link=links.name,
    )
    joined = VirtualNetwork(Scenario(nodes=nodes), table, seed=1, rules=rules, disturb=by_sound)
    # The medium of datagrams is as slow as sound, so they get a twentieth of a second.
    aerials = tuple(
        NodeSpec(address=each, position=(75.0 * each, 0.0, 0.0)) for each in table.nodes
    )
    for link, disturb in (("radio", by_radio), ("satellite", by_satellite)):
        joined.add_link(
            link,
            Scenario(nodes=aerials, profile="ideal", channel="none"),
            modem=Modem(addressed=False, checked=False, senses_carrier=False),
            disturb=disturb,
        )
    return joined


def main() -> None:
    """Let three hours pass, with a report every 20 seconds."""
    joined = network()
    for number in range(540):
        joined.at(20.0 * number + 5.0, partial(joined.publish, AUV, NAV, b"%d" % number))
    joined.run(until_s=10900.0)
    delays_s: dict[str, list[float]] = {"at the surface": [], "below": [], "far out": []}
    for sample in joined.samples(SHORE, NAV):
        given_s = 20.0 * int(bytes(sample.value)) + 5.0
        where = "at the surface" if is_surfaced(given_s) else "below"
        where = "far out" if given_s >= LEAVES_S else where
        delays_s[where].append(sample.received_at / NS_PER_S - given_s)
    for where, found_s in delays_s.items():
        median_s = sorted(found_s)[len(found_s) // 2]
        print(f"{where}: {len(found_s)} reports, {median_s:.2f} s in the middle")
    (status,) = joined.engine(AUV).bonds
    print(f"in use now: {status.in_use}; {status.again} frames went again by the next link")
    assert len(delays_s["at the surface"]) >= 70
    assert status.in_use == "satellite"


if __name__ == "__main__":
    main()
