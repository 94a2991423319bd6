"""The log of the demo: written from its processes' lines, read by views and verdict.

It combines two kinds of facts. The clients report what they gave to Zenoh and what Zenoh gave to
them: that is the user's view. The medium reports its frames (`media` defines the lines): that is
the cost. All use the machine's monotonic clock, so their instants are comparable.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

from zacoustic.app.tools.demo.lanes import Lane, Lanes
from zacoustic.app.tools.demo.networks import NAMES, SHORE, VEHICLE
from zacoustic.app.tools.demo.notes import AnyNote, Arrived, Crossed, Emitted, Sent, Started
from zacoustic.core.base.stats import NO_STREAM
from zacoustic.core.streams.table import StreamTable

# A client gets a sample at once after its frame has arrived, if the machine is not too busy.
_TOGETHER_S: Final = 0.4


class Frame:
    """One frame on the channel, now or earlier."""

    def __init__(
        self,
        source: int,
        sequence: int,
        *,
        frame_bytes: int,
        airtime_s: float,
        sound_s: float,
        began_at: float,
    ) -> None:
        self.source = source
        self.sequence = sequence
        self.frame_bytes = frame_bytes
        self.airtime_s = airtime_s
        """How long it occupies the channel, s."""
        self.sound_s = sound_s
        """Duration of its sound, s."""
        self.began_at = began_at
        """Instant of the first sound, s, monotonic."""
        self.outcome: str | None = None
        """Its outcome at the other side; None: still under way."""
        self.carried: list[Crossed] = []
        """Its contents that reached a client."""

    @property
    def target(self) -> int:
        """Address of the other side."""
        return VEHICLE if self.source == SHORE else SHORE


class Logbook:
    """All known events.

    Args:
        table: The streams.
        clock: The monotonic clock of the machine, s.
        propagation_s: Propagation delay between the two sides, s.
    """

    def __init__(
        self, table: StreamTable, clock: Callable[[], float], *, propagation_s: float
    ) -> None:
        self.lanes = Lanes(table)
        self.propagation_s = propagation_s
        self.frames: list[Frame] = []
        self.waiting: Counter[int] = Counter()
        """Frames that a modem has taken and not begun to transmit, by address, if reported."""
        self.overhead_bytes: dict[int, int] = {}
        """Bytes that belong to no stream (HELLO and others), by address of the gateway."""
        self.began_at: float | None = None
        """Instant of the clients' start, s, monotonic."""
        self.ready: set[str] = set()
        """Children that are ready."""
        self.done: set[str] = set()
        """Clients that have finished."""
        self._clock = clock

    @property
    def elapsed_s(self) -> float:
        """Time since the clients' start, s; 0 before."""
        return 0.0 if self.began_at is None else self._clock() - self.began_at

    @property
    def airtime_s(self) -> float:
        """Airtime of all frames so far, s."""
        return sum(frame.airtime_s for frame in self.frames)

    @property
    def transmitted_bytes(self) -> int:
        """Bytes on the channel so far, of all frames."""
        return sum(frame.frame_bytes for frame in self.frames)

    @property
    def ledger_bytes(self) -> int:
        """Bytes that the gateways have given to their modems, by their ledgers."""
        lanes = sum(lane.transmitted_bytes or 0 for lane in self.lanes)
        return lanes + sum(self.overhead_bytes.values())

    @property
    def has_all_crossed(self) -> bool:
        """Whether both clients have finished and nothing is missing."""
        return {"vehicle", "console"} <= self.done and not any(lane.missing for lane in self.lanes)

    def lost_frames(self, source: int | None = None) -> int:
        """Return the number of lost frames, of one side or of all."""
        return sum(
            frame.outcome not in (None, "received")
            for frame in self.frames
            if source in (None, frame.source)
        )

    def on_the_channel(self) -> list[Frame]:
        """Return the frames that have not reached their end yet."""
        return [frame for frame in self.frames if frame.outcome is None]

    def take(self, child: str, record: Mapping[str, Any]) -> list[AnyNote]:
        """Take an object of a child; return the notes to print."""
        event = record.get("event")
        if event in ("ready", "listening"):
            self.ready.add(child)
            return [Started(at_s=self.elapsed_s, child=child)]
        if event == "done":
            self.done.add(child)
            return []
        if child in ("vehicle", "console"):
            return self._hear_client(child, str(event), record)
        return self._hear_medium(str(event), record)

    def take_ledger(self, address: int, bytes_by_stream: Mapping[int, int]) -> None:
        """Take in the airtime ledger of a gateway: bytes given to its link, by stream."""
        self.overhead_bytes[address] = bytes_by_stream.get(NO_STREAM, 0)
        for lane in self.lanes:
            if lane.source == address:
                lane.transmitted_bytes = bytes_by_stream.get(lane.stream_id, 0)

    def _hear_medium(self, event: str, record: Mapping[str, Any]) -> list[AnyNote]:
        if event == "waiting":
            self.waiting[record["source"]] += 1
        if event == "emission":
            frame = Frame(
                record["source"], record["sequence"], frame_bytes=record["frame_bytes"],
                airtime_s=record["airtime_s"], sound_s=record.get("sound_s", record["airtime_s"]),
                began_at=self._clock(),
            )  # fmt: skip
            self.waiting[frame.source] = max(0, self.waiting[frame.source] - 1)
            self.frames.append(frame)
            return [
                Emitted(
                    at_s=self.elapsed_s, source=frame.source, frame_bytes=frame.frame_bytes,
                    airtime_s=frame.airtime_s,
                )
            ]  # fmt: skip
        if event == "reception":
            for frame in reversed(self.frames):
                if (frame.source, frame.sequence) == (record["source"], record["sequence"]):
                    frame.outcome = record["outcome"]
                    return [
                        Arrived(
                            at_s=self.elapsed_s, source=frame.source, target=record["node"],
                            frame_bytes=frame.frame_bytes, outcome=record["outcome"],
                            propagation_s=record["propagation_s"],
                        )
                    ]  # fmt: skip
        return []

    def _hear_client(self, child: str, event: str, record: Mapping[str, Any]) -> list[AnyNote]:
        own = VEHICLE if child == "vehicle" else SHORE
        other = SHORE if own == VEHICLE else VEHICLE
        key, at, value = record["key"], record["at"], record["value"]
        if event == "put":
            return [self._sent(self.lanes.of_key(key, own), record["count"], at, value)]
        if event == "received":
            return [self._crossed(self.lanes.of_key(key, other), record["count"], at, value)]
        request, response = self.lanes.of_call(key, "request"), self.lanes.of_call(key, "response")
        if event == "call":
            return [self._sent(request, record["count"], at, value)]
        if event == "served":
            # The server does not know the number of the call; it serves calls in order.
            count = request.next_unreceived()
            notes: list[AnyNote] = [self._crossed(request, count, at, value)]
            return [*notes, self._sent(response, count, at, record["answer"])]
        if event in ("answer", "refusal"):
            return [self._crossed(response, record["count"], at, value)]
        return []

    def _sent(self, lane: Lane, count: int, at: float, value: object) -> Sent:
        lane.send(count, at, value)
        return Sent(
            at_s=self._since_go(at), stream=lane.name, source=lane.source, count=count, value=value
        )

    def _crossed(self, lane: Lane, count: int, at: float, value: object) -> Crossed:
        note = Crossed(
            at_s=self._since_go(at), stream=lane.name, source=lane.source, count=count,
            delay_s=lane.receive(count, at, value), value=value,
        )  # fmt: skip
        frame = self._frame_of(lane.source, at)
        if frame is not None:
            frame.carried.append(note)
        return note

    def _frame_of(self, source: int, at: float) -> Frame | None:
        """Return the frame that carried what a client received at an instant."""
        for frame in reversed(self.frames):
            arrives_at = frame.began_at + frame.sound_s + self.propagation_s
            if frame.source == source and abs(at - arrives_at) < _TOGETHER_S:
                return frame
        return None

    def _since_go(self, at: float) -> float:
        return 0.0 if self.began_at is None else at - self.began_at


def network_name(address: int) -> str:
    """Return the name of a side, for people."""
    return NAMES.get(address, str(address))
