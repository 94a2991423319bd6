"""Five nodes in a line: the vehicle at its end reports, and obeys, over three relays.

Run it: python examples/13_line_of_five.py
"""

from functools import partial

from zacoustic.core.engine.events import Event, RequestReceived, ResponseReceived
from zacoustic.testing import (
    Engine,
    NodeSpec,
    Route,
    Scenario,
    ServiceSpec,
    StreamTable,
    TopicSpec,
    TransmitRules,
    VirtualNetwork,
)

SHORE, AUV = 1, 5
NAV, ARM = 1, 2
APART_M = 1500.0


def network() -> VirtualNetwork:
    """Each node hears the next one; the ends are six kilometres apart."""
    table = StreamTable(
        [
            TopicSpec(stream_id=NAV, name="auv/nav", publishers=(AUV,), subscribers=(SHORE,)),
            ServiceSpec(stream_id=ARM, name="auv/arm", server=AUV, timeout_s=300.0),
        ],
        nodes={SHORE: "shore", 2: "buoy2", 3: "buoy3", 4: "buoy4", AUV: "auv"},
    )
    nodes = tuple(
        NodeSpec(address=each, position=(APART_M * each, 0.0, 10.0)) for each in table.nodes
    )
    far = Route(route_id=1, name="far", path=(SHORE, 2, 3, 4, AUV), link="link")
    relay = TransmitRules(routes=(far,))
    end = TransmitRules(routes=(far,), links_of_streams={NAV: "far", ARM: "far"})
    rules = {each: end if each in (SHORE, AUV) else relay for each in table.nodes}
    return VirtualNetwork(Scenario(nodes=nodes), table, seed=1, rules=rules)


def answer(channel: VirtualNetwork) -> None:
    """Let the vehicle answer the requests that have arrived."""
    for node, event in channel.events:
        if node == AUV and isinstance(event, RequestReceived):
            channel.apply(AUV, partial(_reply, event))


def _reply(event: RequestReceived, engine: Engine, now: int) -> None:
    engine.reply(event.call, b"armed", now)


def main() -> None:
    """Let an hour pass: a report every two minutes, and one call."""
    channel = network()
    for number in range(30):
        channel.at(120.0 * number, partial(channel.publish, AUV, NAV, b"depth %d" % number))
    channel.at(
        1800.0, lambda: channel.apply(SHORE, lambda engine, now: engine.call(ARM, b"now", now))
    )
    channel.every(1.0, partial(answer, channel))
    channel.run(until_s=3900.0)
    reports = [event.value for event in channel.samples(SHORE, NAV)]
    answers: list[Event] = [
        event for node, event in channel.events if isinstance(event, ResponseReceived)
    ]
    print(f"{len(reports)} of 30 reports have come over four hops, {len(answers)} answer")
    for address in range(AUV, SHORE, -1):
        (hop,) = [each for each in channel.engine(address).hops if each.next_node == address - 1]
        print(f"{address} to {hop.next_node}: {hop.transmissions} sent, {hop.passed_on} there")
    assert reports == [b"depth %d" % number for number in range(30)]
    assert len(answers) == 1


if __name__ == "__main__":
    main()
