"""A mooring and a ship that never hear each other: a glider carries the log home.

Run it: python examples/15_data_mule.py
"""

from collections.abc import Sequence
from functools import partial

from zacoustic import Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.testing import (
    Carry,
    ContactRules,
    NodeSpec,
    Scenario,
    StreamTable,
    TopicSpec,
    TransmitRules,
    VirtualNetwork,
)

MOORING, GLIDER, SHIP = 1, 2, 3
LOG = 1
PERIOD_S, STAYS_S = 3600.0, 300.0


def hears(source: int, node: int, now: int) -> Sequence[float]:
    """Return when a frame arrives, s after it was due: only beside the glider, now and then."""
    at_s, ends = now / NS_PER_S % PERIOD_S, {source, node}
    beside_mooring = ends == {MOORING, GLIDER} and at_s < STAYS_S
    beside_ship = ends == {GLIDER, SHIP} and 0 <= at_s - PERIOD_S / 2 < STAYS_S
    return (0.0,) if beside_mooring or beside_ship else ()


def network() -> VirtualNetwork:
    """Return the three nodes."""
    log = TopicSpec(
        stream_id=LOG,
        name="mooring/log",
        publishers=(MOORING,),
        subscribers=(SHIP,),
        qos=Qos(reliability=Reliability.RELIABLE, depth=1000),
        journal=True,
        carry=Carry(by=(GLIDER,)),
    )
    table = StreamTable([log], nodes={MOORING: "mooring", GLIDER: "glider", SHIP: "ship"})
    nodes = tuple(
        NodeSpec(address=each, position=(400.0 * each, 0.0, 10.0)) for each in table.nodes
    )
    # Who passes for minutes says that it is there: nobody calls out to a silent node for ever.
    heard = TransmitRules(contact=ContactRules(heartbeat_s=60.0))
    return VirtualNetwork(Scenario(nodes=nodes), table, seed=1, disturb=hears, rules=heard)


def main() -> None:
    """Let six hours pass, with a line every two minutes."""
    joined = network()
    for number in range(150):
        joined.at(120.0 * number, partial(joined.publish, MOORING, LOG, b"line %d" % number))
    for hour in range(1, 7):
        joined.run(until_s=hour * PERIOD_S)
        kept = joined.engine(GLIDER).carry
        assert kept is not None
        print(f"hour {hour}: {len(joined.samples(SHIP, LOG))} lines at the ship, "
              f"{kept.carried} with the glider")  # fmt: skip
    lines = [bytes(sample.value) for sample in joined.samples(SHIP, LOG)]
    assert lines == [b"line %d" % number for number in range(len(lines))]
    assert len(lines) > 140


if __name__ == "__main__":
    main()
