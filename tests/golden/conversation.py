"""Conversations of two nodes: recorded on a simulated channel, and replayed to one of them.

What the applications give is data (`Line.gives`), so a replay gives the same.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import msgspec

from tests.golden.fields import Fields, Reader, in_json
from tests.golden.tables import TABLES
from tests.virtual.sealed import SealedFleet
from zacoustic.app.tools.inspect.decode.opening import FrameOpener
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallKey,
    CancelAnswered,
    CancelRequested,
    DeliveryEnded,
    Event,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalKey,
    GoalReceived,
    GoalStatus,
    PeerSeen,
    RequestReceived,
    ResponseReceived,
    ResultReceived,
    SampleReceived,
    StreamsDiffer,
)
from zacoustic.core.linktypes import LinkMetrics, ReceivedFrame
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import FleetKey
from zacoustic.testing.virtual import Modem, VirtualNetwork

NS_PER_S: Final = 1_000_000_000
APART_M: Final = 750.0
"""Distance of the two nodes: half a second."""
NODES: Final = (1, 2)
SEED: Final = 1
_MODEM: Final = Modem(senses_carrier=False)


class Given(msgspec.Struct, frozen=True):
    """What an application gives."""

    at_s: float
    node: int
    gives: dict[str, Any]


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """What happens in a conversation, apart from the engines."""

    name: str
    about: str
    tables: dict[int, str]
    """Name of the table of each node."""
    given: tuple[Given, ...]
    lost: tuple[tuple[int, int], ...] = ()
    """Frames that do not arrive: source, and which of its frames, from 1."""
    key: FleetKey | None = None
    """The key of the fleet; None: frames are not sealed."""
    until_s: float = 300.0


class Line(msgspec.Struct, frozen=True, omit_defaults=True):
    """One event at one node."""

    at_ns: int
    """Instant since both nodes have started, ns."""
    node: int
    gives: dict[str, Any] = {}
    """What its application gives."""
    sends: str = ""
    """The frame that it begins to transmit, or gives to its busy modem: `1.3` is the third of
    node 1."""
    to: int = 0
    """Its destination, or 255."""
    hex: str = ""
    """Its bytes."""
    seal: dict[str, Any] = {}
    """What its seal says."""
    records: str = ""
    """The records inside of a seal."""
    fields: list[Fields] = []
    """The controls and records."""
    sent: str = ""
    """The frame whose transmission has ended."""
    hears: str = ""
    """The frame that has arrived."""
    loses: str = ""
    """The frame that was lost on its way to it."""
    receives: dict[str, Any] = {}
    """What its application receives."""


class Conversation(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A scene with all that the engines have made of it."""

    name: str
    about: str
    tables: dict[str, str]
    """Name of the table of each node."""
    epochs: dict[str, int]
    """Boot epoch of each node; its life, where frames are sealed."""
    key: dict[str, Any] = {}
    """The key of the fleet, where frames are sealed; the port is 0."""
    link: dict[str, Any]
    """The capabilities of the link."""
    lines: list[Line]


def record(scene: Scene) -> Conversation:
    """Let the engines play a scene."""
    recorder = _Recorder(scene)
    recorder.run()
    network, key = recorder.network, scene.key
    stated = msgspec.to_builtins(network.capabilities(1))
    return Conversation(
        name=scene.name,
        about=scene.about,
        tables={str(node): name for node, name in scene.tables.items()},
        epochs={str(node): 1 for node in NODES},
        key={}
        if key is None
        else {
            "network": key.network,
            "generation": key.generation,
            "secret": key.secret.hex(),
        },
        link={name: stated[name] for name in _LINK},
        lines=recorder.lines,
    )


def replay(scene: Scene, conversation: Conversation, node: int, seed: int = SEED) -> list[Line]:
    """Give what one node has heard and was given to a fresh engine; return what that does.

    Args:
        scene: The scene.
        conversation: What was recorded.
        node: Address of the node that is fresh.
        seed: Another one than `SEED` gives the engine other random numbers.
    """
    recorder = _Recorder(scene, only=node, seed=seed)
    frames = {line.sends: line for line in conversation.lines if line.sends}
    for line in conversation.lines:
        if line.node == node and line.hears:
            heard = partial(recorder.hear, node, frames[line.hears])
            recorder.network.at(line.at_ns / NS_PER_S, heard)
    recorder.run()
    return recorder.lines


_LINK: Final = (
    "mtu_bytes", "bit_rate_bps", "preamble_s", "gap_s", "propagation_s", "half_duplex",
    "addressed", "checked", "framed", "senses_carrier",
)  # fmt: skip


class _Recorder:
    """A network that writes down what happens in it.

    Args:
        scene: What happens in it.
        only: Address of the one node that takes part; None: both do.
        seed: Of the random numbers of the engines.
    """

    def __init__(self, scene: Scene, only: int | None = None, seed: int = SEED) -> None:
        nodes = tuple(
            NodeSpec(address=each, position=(APART_M * (each - 1), 0.0, 10.0)) for each in NODES
        )
        scenario = Scenario(nodes=nodes, channel="none", seed=seed)
        here = self._here = NODES if only is None else (only,)
        self.lines: list[Line] = []
        self._scene = scene
        self._sent: dict[int, int] = dict.fromkeys(NODES, 0)
        self._ended: dict[int, list[int]] = {each: [] for each in NODES}
        self._readers = {each: Reader(TABLES[scene.tables[each]]) for each in NODES}
        self._openers = {each: self._opener(scene, each) for each in NODES}
        self.network = VirtualNetwork(
            scenario,
            {each: TABLES[scene.tables[each]] for each in here},
            modem=_MODEM,
            deliver=self._deliver,
            trace=self._note,
            digest=False,
            disturb=self._arrive,
            build=Engine if scene.key is None else SealedFleet(scene.key),
        )
        for each in scene.given:
            if each.node in here:
                self.network.at(each.at_s, partial(self._give, each))

    def run(self) -> None:
        """Let it all happen."""
        self.network.run(until_s=self._scene.until_s)

    def hear(self, node: int, sent: Line) -> None:
        """Let a node hear a recorded frame."""
        received = ReceivedFrame(
            frame_bytes=bytes.fromhex(sent.hex),
            received_at=self.network.now,
            source=sent.node,
            destination=sent.to,
            metrics=LinkMetrics(propagation_s=APART_M / 1500),
        )
        self._add(node, hears=sent.sends)
        self.network.apply(node, lambda engine, now: engine.handle_frame(received, now))

    def _add(self, node: int, **said: Any) -> None:
        self.lines.append(Line(self.network.now, node, **said))

    def _give(self, given: Given) -> None:
        self._add(given.node, gives=given.gives)
        self.network.apply(given.node, lambda engine, now: give(engine, now, given.gives))

    def _note(self, record: TraceRecord) -> None:
        node = record.node
        if record.what == "report":
            self._ended[node].append(record.at)
            self._add(node, sent=f"{node}.{len(self._ended[node])}")
        if record.what == "transmit":
            self._sent[node] += 1
            self._transmits(node, record)

    def _transmits(self, node: int, record: TraceRecord) -> None:
        opener, frame = self._openers[node], bytes.fromhex(record.frame)
        said: dict[str, Any] = {"sends": f"{node}.{self._sent[node]}", "to": record.peer}
        records = frame
        if opener is not None:
            opening = opener.open(frame, source=node, destination=record.peer)
            assert opening.records is not None
            records = opening.records
            said |= {"seal": opening.item.value, "records": records.hex()}
        fields = self._readers[node].read(records, node, record.peer)
        self._add(node, hex=record.frame, fields=fields, **said)

    def _arrive(self, source: int, node: int, now: int) -> Sequence[float]:
        """Lose a frame, or hand it over."""
        if node not in self._here:
            return ()
        ended, delay_ns = self._ended[source], round(APART_M / 1500 * NS_PER_S)
        number = 1 + min(range(len(ended)), key=lambda index: abs(ended[index] + delay_ns - now))
        is_lost = (source, number) in self._scene.lost
        self._add(node, **{"loses" if is_lost else "hears": f"{source}.{number}"})
        return () if is_lost else (0.0,)

    def _deliver(self, node: int, event: Event) -> None:
        received = said_of(event)
        if received:
            self._add(node, receives=received)

    @staticmethod
    def _opener(scene: Scene, node: int) -> FrameOpener | None:
        if scene.key is None:
            return None
        cipher, digest = FleetCipher(scene.key), TABLES[scene.tables[node]].digest
        return FrameOpener(cipher, nodes=NODES, digest=digest)


def give(engine: Engine, now: int, gives: Mapping[str, Any]) -> None:
    """Do what an application gives: one word, and its parameters."""
    ((word, said),) = gives.items()
    stream_id: int = said["stream"]
    value = said["value"] if "value" in said else bytes.fromhex(said.get("payload", ""))
    goal = call = None
    if "goal" in said:
        goal = GoalKey(said["client"], said["epoch"], stream_id, said["goal"])
    if "call" in said:
        call = CallKey(said["client"], said["epoch"], stream_id, said["call"])
    match word:
        case "publish":
            engine.publish(stream_id, value, now)
        case "call":
            engine.call(stream_id, value, now)
        case "reply" if call is not None:
            assert engine.reply(call, value, now)
        case "send_goal":
            engine.actions.send_goal(stream_id, value, now)
        case "accept" if goal is not None:
            assert engine.actions.accept(goal, now)
        case "feedback" if goal is not None:
            engine.actions.publish_feedback(goal, value, now)
        case "cancel" if goal is not None:
            assert engine.actions.cancel_goal(goal, now)
        case "agree" if goal is not None:
            assert engine.actions.answer_cancel(goal, now, accepted=True)
        case "finish" if goal is not None:
            status = GoalStatus(said["status"])
            assert engine.actions.finish(goal, status, value, now)
        case _:
            raise AssertionError(f"{word} is nothing that an application gives")


def said_of(event: Event) -> dict[str, Any]:
    """Return what an event tells an application; empty: it is none of a conversation."""
    match event:
        case PeerSeen():
            said: dict[str, Any] = {"node": event.address, "epoch": event.epoch}
            return {"peer": {**said, "same_table": event.same_table}}
        case StreamsDiffer():
            return {"stream_differs": {"node": event.address, "stream": event.stream_id}}
        case SampleReceived():
            said = {"stream": event.stream_id, "source": event.source}
            if event.instance:
                said["wildcards"] = list(event.instance)
            said |= {"deleted": True} if event.deleted else {"value": in_json(event.value)}
            return {"sample": said}
        case DeliveryEnded():
            said = {"stream": event.stream_id, "outcome": event.outcome.value}
            return {"delivery": {**said, "missing": list(event.missing)}}
        case RequestReceived():
            key = event.call
            said = {"client": key.client, "epoch": key.epoch, "stream": key.stream_id}
            return {"request": {**said, "call": key.number, "value": in_json(event.value)}}
        case ResponseReceived():
            return {"response": {"stream": event.stream_id, "value": in_json(event.value)}}
        case CallFailed():
            said = {"stream": event.stream_id, "failure": int(event.failure)}
            return {"call_failed": {**said, "text": event.text}}
        case GoalReceived():
            return {"goal": {**_goal(event.goal), "value": in_json(event.value)}}
        case GoalAnswered():
            return {"goal_answered": {**_goal(event.goal), "accepted": event.accepted}}
        case FeedbackReceived():
            return {"feedback": {**_goal(event.goal), "value": in_json(event.value)}}
        case CancelRequested():
            return {"cancel": _goal(event.goal)}
        case CancelAnswered():
            return {"cancel_answered": {**_goal(event.goal), "accepted": event.accepted}}
        case ResultReceived():
            said = {"status": int(event.status), "value": in_json(event.value)}
            return {"result": {**_goal(event.goal), **said}}
        case GoalFailed():
            return {"goal_failed": {**_goal(event.goal), "failure": int(event.failure)}}
    return {}


def _goal(key: GoalKey) -> dict[str, Any]:
    said = {"client": key.client, "epoch": key.epoch, "stream": key.stream_id}
    return {**said, "goal": key.number}
