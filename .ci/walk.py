"""The way of a frame through the engine, counted: `make shape` prints it beside the shape.

Two nodes without routes, bonds, floods, carried topics and a seal exchange one of each kind, after
each was exchanged once, so that agreement, round trips and caches are warm. A profiler counts both
engines together: functions, crossings from one room of the core to another, calls. Comprehensions
and generator expressions are no calls. The counts depend on no clock and on no random number of the
machine, so a rise has a cause in the source.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any, Final

import msgspec

import zacoustic
from zacoustic import GoalStatus, Qos, Reliability
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.engine.events import Event, GoalReceived, RequestReceived
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

CORE: Final = str(Path(zacoustic.__file__).parent / "core") + "/"
SETTLING_S: Final = 300.0
"""Time in which whatever follows an exchange has ended, s."""
VALUE: Final = b"twelve bytes"


class Walk(msgspec.Struct, frozen=True, kw_only=True):
    """Count of the code that both engines run for one exchange."""

    functions: int
    """Different functions."""
    crossings: int
    """Calls from one room of the core into another."""
    calls: int
    """Calls in all."""


class _Profiler:
    """Counts calls inside of the core."""

    def __init__(self) -> None:
        self.calls: Counter[tuple[str, str]] = Counter()
        self.crossings = 0
        self._rooms: list[str] = []

    def __call__(self, frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if not code.co_filename.startswith(CORE) or code.co_name.startswith("<"):
            return
        if event == "call":
            room = code.co_filename.removeprefix(CORE).partition("/")[0]
            self.calls[code.co_filename, code.co_qualname] += 1
            self.crossings += bool(self._rooms) and self._rooms[-1] != room
            self._rooms.append(room)
        elif event == "return" and self._rooms:
            self._rooms.pop()


def main() -> None:
    """Print the walks, and what an idle engine consists of."""
    print("\nway of a frame, both engines: functions, crossings, calls")
    for kind, walk in walks().items():
        print(f"  {kind:18}{walk.functions:6}{walk.crossings:6}{walk.calls:7}")
    found = live_objects(network().engine(1))
    print(f"live objects of an idle engine: {found.total()} of {len(found)} classes")


def walks() -> dict[str, Walk]:
    """Return the walk of each kind of exchange."""
    sea = network()
    ends_s = SETTLING_S
    sea.run(until_s=ends_s)
    for act in ACTS.values():
        act(sea)
        ends_s += SETTLING_S
        sea.run(until_s=ends_s)
    found: dict[str, Walk] = {}
    for kind, act in ACTS.items():
        profiler = _Profiler()
        sys.setprofile(profiler)
        try:
            act(sea)
            ends_s += SETTLING_S
            sea.run(until_s=ends_s)
        finally:
            sys.setprofile(None)
        calls = profiler.calls
        found[kind] = Walk(functions=len(calls), crossings=profiler.crossings, calls=calls.total())
    return found


def network() -> VirtualNetwork:
    """Return two nodes, 500 m apart, that serve each other."""
    nodes = [{"address": each, "position": [500.0 * each, 0, 10]} for each in (1, 2)]
    table = StreamTable(
        [
            TopicSpec(stream_id=10, name="a/nav"),
            TopicSpec(stream_id=11, name="a/cmd", qos=Qos(reliability=Reliability.RELIABLE)),
            ServiceSpec(stream_id=20, name="a/arm", server=2),
            ActionSpec(stream_id=30, name="a/goto", server=2),
        ],
        nodes={1: "shore", 2: "auv"},
    )

    def deliver(address: int, event: Event) -> None:
        match event:
            case RequestReceived():
                sea.apply(address, lambda engine, now: engine.reply(event.call, VALUE, now))
            case GoalReceived():
                sea.apply(address, lambda engine, now: engine.actions.accept(event.goal, now))
                sea.apply(
                    address,
                    lambda engine, now: engine.actions.finish(
                        event.goal, GoalStatus.SUCCEEDED, VALUE, now
                    ),
                )
            case _:
                pass

    sea = VirtualNetwork(
        scenario_from_mapping({"nodes": nodes, "channel": "none", "seed": 1}, source="walk"),
        table,
        deliver=deliver,
        digest=False,
    )
    return sea


ACTS: Final[Mapping[str, Callable[[VirtualNetwork], object]]] = {
    "best-effort sample": lambda sea: sea.publish(1, 10, VALUE),
    "reliable sample": lambda sea: sea.publish(1, 11, VALUE),
    "call": lambda sea: sea.apply(1, lambda engine, now: engine.call(20, VALUE, now)),
    "goal": lambda sea: sea.apply(1, lambda engine, now: engine.actions.send_goal(30, VALUE, now)),
    "400 bytes": lambda sea: sea.publish(1, 11, VALUE * 33),
}
"""First command of each exchange."""


def live_objects(root: object) -> Counter[str]:
    """Return how many objects of the core one of them refers to, by class, itself included."""
    found: Counter[str] = Counter()
    seen: set[int] = set()
    todo = [root]
    while todo:
        thing = todo.pop()
        if id(thing) in seen or isinstance(thing, (str, bytes, int, float, type)):
            continue
        seen.add(id(thing))
        if type(thing).__module__.startswith("zacoustic.core."):
            found[type(thing).__qualname__] += 1
        todo += _referents(thing)
    return found


def _referents(thing: Any) -> Iterator[object]:  # noqa: ANN401 (whatever an object has)
    if isinstance(thing, Mapping):
        yield from thing
        yield from thing.values()
    elif isinstance(thing, (list, tuple, set, frozenset)):
        yield from thing
    elif type(thing).__module__.startswith("zacoustic.core."):
        yield from getattr(thing, "__dict__", {}).values()
        for kind in type(thing).__mro__:
            for name in getattr(kind, "__slots__", ()):
                if hasattr(thing, name):
                    yield getattr(thing, name)
    elif hasattr(thing, "__self__"):
        yield thing.__self__
    elif hasattr(thing, "func"):
        yield from (thing.func, *thing.args, *thing.keywords.values())
    else:
        yield from (each.cell_contents for each in getattr(thing, "__closure__", None) or ())


if __name__ == "__main__":
    main()
