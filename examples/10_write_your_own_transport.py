"""A transport of your own: nodes ask each other whether they are there, in a control of its own.

Run it: python examples/10_write_your_own_transport.py
"""

from functools import partial

from zacoustic.core.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.transport import contract as ct
from zacoustic.testing import Engine, NodeSpec, Scenario, StreamTable, TopicSpec, VirtualNetwork

CODE = 0xE0
"""For private use (docs/wire.md, section 3): behind it, in one byte, number and direction."""
ANSWER = 0x80
ATTEMPTS = 5
FIRST_PAUSE_NS = 10 * NS_PER_S


class Answered(ct.TransportEvent, frozen=True, kw_only=True):
    """A node is there."""

    address: int
    round_trip_s: float


class Missed(ct.TransportEvent, frozen=True, kw_only=True):
    """A node has not answered."""

    address: int


class Ping(ct.Transport):
    """Asks again, each time after twice the pause, until there is an answer."""

    name = "ping"

    def __init__(self, context: ct.Context) -> None:
        super().__init__(context)
        self.number = 0
        self.asked: dict[int, tuple[int, int, int]] = {}  # node: number, when, attempts made
        self.due: dict[int, int] = {}  # node: what is to be said to it
        context.reception.on_extension(CODE, self.take)
        context.peers.forgotten.connect(self.forget)

    def ping(self, address: int, now: int) -> None:
        """Ask a node; `Answered` or `Missed` follows. Not twice at a time."""
        if address not in self.asked:
            self.number = (self.number + 1) % ANSWER
            self.asked[address] = self.number, now, 0
            self.ask(address, now)

    def ask(self, address: int, now: int) -> None:
        """Ask for the first time or again, or give up."""
        number, asked_at, attempts = self.asked[address]
        if attempts == ATTEMPTS:
            self.forget(address, now)
            self.context.emit(Missed(address=address))
            return
        self.asked[address] = number, asked_at, attempts + 1
        self.due.setdefault(address, number)
        again_at = now + (FIRST_PAUSE_NS << attempts)
        key = (ct.Due.TRANSPORT, self.name, address)
        self.context.timers.at(key, again_at, partial(self.ask, address))

    def forget(self, address: int, now: int) -> None:
        """Nothing is to be kept of a node."""
        self.asked.pop(address, None)
        self.due.pop(address, None)
        self.context.timers.cancel((ct.Due.TRANSPORT, self.name, address))

    def due_at(self, now: int) -> int | None:
        """Return when a frame is to go, ns."""
        return now if self.due else None

    def offer(self, now: int) -> ct.Offer | None:
        """Ask for a frame to the node that waits longest."""
        return ct.Offer(destination=next(iter(self.due)), owed_first=True) if self.due else None

    def say(self, destination: int, room_bytes: int, now: int) -> ct.Said | None:
        """Say in any frame to that node what is due."""
        if destination not in self.due or room_bytes < 1:
            return None
        body = bytes((self.due.pop(destination),))
        return ct.Said(extension=ct.Extension(CODE, body))

    def take(self, heard: ct.Heard, body: bytes) -> str | None:
        """Take a question or an answer; anything may arrive, and late, and twice."""
        if not heard.is_unicast or len(body) != 1:
            return "payload"
        if body[0] < ANSWER:
            self.due[heard.source] = body[0] | ANSWER
            return None
        number, asked_at, _ = self.asked.get(heard.source, (None, 0, 0))
        if number != body[0] - ANSWER:
            return "unexpected_answer"
        self.forget(heard.source, heard.now)
        round_trip_s = ns_to_seconds(heard.now - asked_at)
        self.context.emit(Answered(address=heard.source, round_trip_s=round_trip_s))
        return None


def ping(address: int, engine: Engine, now: int) -> None:
    """Have an engine ask a node."""
    engine.transport(Ping).ping(address, now)


def main() -> None:
    """Ping two nodes 1.5 km and 3 km away, and one that is not there."""
    nodes = tuple(NodeSpec(address=1 + n, position=(1500.0 * n, 0.0, 10.0)) for n in range(3))
    table = StreamTable([TopicSpec(stream_id=1, name="log")], nodes={1: "shore", 2: "a", 3: "b"})
    channel = VirtualNetwork(
        Scenario(nodes=nodes), table, seed=1, build=partial(Engine, transports=[Ping])
    )
    for address in (2, 3, 4):
        channel.apply(1, partial(ping, address))
    channel.run()
    told = [event for _, event in channel.events if isinstance(event, ct.TransportEvent)]
    for event in told:
        print(event)
    assert {type(event) for event in told} == {Answered, Missed}
    assert len(told) == 3


if __name__ == "__main__":
    main()
