"""A fleet on a schedule in which something goes wrong, and what the medium says about it.

What collides is computed from positions, the speed of sound, and the instants and sizes of frames
alone: no part of an engine has a say in it.
"""

import bisect
import math
import random
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.schedule import ScheduleWish, distance_of, make_schedule
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.linktypes import ReceivedFrame
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import AccessStateChanged, Event, SampleReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import AutoSpec, ScheduleSpec
from zacoustic.core.schedule.access.base import AccessState
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

SOUND_M_S: Final = 1500.0
CLOCK_ERROR_S: Final = 0.01
LINK: Final = Modem().capabilities(profile_named(DEFAULT_PROFILE), 1.0)
Place = tuple[float, float, float]


class Sent(msgspec.Struct, frozen=True):
    """A frame on the medium."""

    at_s: float
    airtime_s: float
    node: int


class Unmeasured(Engine):
    """A node whose modem measures no delay."""

    def handle_frame(self, frame: ReceivedFrame, now: int, link: str | None = None) -> None:
        """Take a frame without what its modem would have measured."""
        metrics = msgspec.structs.replace(frame.metrics, propagation_s=None)
        super().handle_frame(msgspec.structs.replace(frame, metrics=metrics), now, link)


class Slotted:
    """A fleet that always has something to send, on a schedule for its places.

    Args:
        seed: Everything follows from it.
        nodes: How many own a slot.
        strangers: How many more own none.
        clocks: What is wrong with the clock of a node.
        auto: The access is "auto".
        measured: The modems measure the delay of each frame.
        absent: Nodes that are not there at the beginning.
        spread_m: They are within this distance.
        every_s: Mean period of a node's samples, s.
        open_slots: Slots for nodes that own none.
    """

    def __init__(
        self,
        seed: int,
        *,
        nodes: int = 5,
        strangers: int = 0,
        clocks: Mapping[int, dict[str, Any]] | None = None,
        auto: bool = False,
        measured: bool = True,
        absent: tuple[int, ...] = (),
        spread_m: float = 1000.0,
        every_s: float = 4.0,
        open_slots: int = 1,
    ) -> None:
        self.rng = rng = random.Random(seed)
        self.addresses = tuple(range(1, nodes + strangers + 1))
        self.places: dict[int, Place] = {
            node: (rng.uniform(0, spread_m), rng.uniform(0, spread_m), rng.uniform(5, 50))
            for node in self.addresses
        }
        wish = ScheduleWish(
            frames=dict.fromkeys(self.addresses[:nodes], 1),
            clock_error_s=CLOCK_ERROR_S,
            newcomer_m=spread_m * math.sqrt(2),
            open_slots=open_slots,
        )
        self.spec: ScheduleSpec = make_schedule(wish, distance_of(self.places), LINK)
        self.cycle_s = self.spec.cycle_s
        stated = {
            node: {
                "node": node,
                "error_s": CLOCK_ERROR_S,
                "offset_s": CLOCK_ERROR_S * rng.uniform(-1, 1),
                **(clocks or {}).get(node, {}),
            }
            for node in self.addresses
        }
        scenario = scenario_from_mapping(
            {
                "nodes": [
                    {"address": node, "position": place} for node, place in self.places.items()
                ],
                "seed": seed,
                "channel": "none",
                "collisions": "protocol",
                "sound_speed_m_s": SOUND_M_S,
                "faults": {"clocks": list(stated.values())},
            },
            source="test",
        )
        table = StreamTable(
            [TopicSpec(stream_id=1, name="{node}/t", qos=Qos(depth=1))],
            nodes={node: f"n{node}" for node in self.addresses},
        )
        access = AutoSpec(slots=self.spec.slots, clock_error_s=CLOCK_ERROR_S) if auto else self.spec
        self.sent: list[Sent] = []
        self.delivered: list[tuple[float, int, int]] = []
        """Instant, s, sender and receiver of each sample."""
        self.states: dict[int, list[tuple[float, AccessState]]] = {}
        self.network = VirtualNetwork(
            scenario,
            table,
            rules=TransmitRules(access=access),
            digest=False,
            trace=self._trace,
            deliver=self._deliver,
            build=Engine if measured else Unmeasured,
        )
        self._every_s = every_s
        for node in self.addresses:
            if node in absent:
                self.network.crash(node)
            self.network.at(rng.uniform(0, every_s), partial(self._say, node))

    def at(self, instant_s: float, action: Callable[[], object]) -> None:
        """Do something at an instant."""
        self.network.at(instant_s, action)

    def run(self, until_s: float) -> None:
        """Run it."""
        self.network.run(until_s=until_s)

    @property
    def now_s(self) -> float:
        """The instant, s."""
        return self.network.now / NS_PER_S

    def times(self, node: int, from_s: float = 0.0) -> list[float]:
        """Return when a node transmitted, s."""
        return [each.at_s for each in self.sent if each.node == node and each.at_s >= from_s]

    def collisions(
        self, from_s: float = 0.0, *, apart_from: tuple[int, ...] = ()
    ) -> Iterator[tuple[Sent, Sent, int]]:
        """Yield each frame that meets another one at a receiver, both, and the receiver.

        Args:
            from_s: Frames before this instant do not count, s.
            apart_from: Frames of these nodes may be lost, and so may frames at these nodes.
        """
        begins = [each.at_s for each in self.sent]
        longest_s = 10.0
        for frame in self.sent:
            if frame.node in apart_from or frame.at_s < from_s:
                continue
            first = bisect.bisect_left(begins, frame.at_s - longest_s)
            last = bisect.bisect_right(begins, frame.at_s + longest_s)
            for receiver in self.addresses:
                if receiver == frame.node or receiver in apart_from:
                    continue
                begin_s, end_s = self._sounds(frame, receiver)
                for other in self.sent[first:last]:
                    other_begin_s, other_end_s = self._sounds(other, receiver)
                    if other is not frame and begin_s < other_end_s and other_begin_s < end_s:
                        yield frame, other, receiver

    def _sounds(self, frame: Sent, receiver: int) -> tuple[float, float]:
        """Return when a receiver hears a frame, or makes it, s."""
        way_s = math.dist(self.places[frame.node], self.places[receiver]) / SOUND_M_S
        return frame.at_s + way_s, frame.at_s + way_s + frame.airtime_s

    def _say(self, node: int) -> None:
        if self.network.is_running(node):
            self.network.publish(node, 1, self.rng.randbytes(self.rng.randint(30, 50)))
        self.network.at(
            self.now_s + self.rng.uniform(0.5, 1.5) * self._every_s, partial(self._say, node)
        )

    def _trace(self, record: TraceRecord) -> None:
        if record.what == "transmit" and record.frame is not None:
            airtime_s = LINK.airtime_ns(len(record.frame) // 2) / NS_PER_S  # hexadecimal
            self.sent.append(Sent(self.now_s, airtime_s, record.node))

    def _deliver(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived):
            self.delivered.append((self.now_s, event.source, address))
        elif isinstance(event, AccessStateChanged):
            self.states.setdefault(address, []).append((event.changed_at / NS_PER_S, event.state))
