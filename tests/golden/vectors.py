"""Makes the wire vectors of docs/wire.md with the real engines.

`test_wire.py` compares them with `wire_native.json`. Vectors are append-only: a changed one is a
changed wire version. After adding one: ``python -m tests.golden.vectors`` from the project's root.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Final

import msgspec
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.kdf.hkdf import HKDFExpand
from cryptography.hazmat.primitives.keywrap import aes_key_wrap

from tests.golden.fields import Fields, Reader
from tests.golden.tables import NAV_VALUE, TABLES, lines
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailure,
    CallKey,
    GoalFailure,
    GoalKey,
    GoalStatus,
    RequestReceived,
)
from zacoustic.core.linktypes import BROADCAST, LinkCapabilities
from zacoustic.core.streams.carry import CARRY_STREAM_ID
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID, CommandKind, RemoteCommand
from zacoustic.core.streams.keydelivery import KEYS_STREAM_ID, encode_delivery
from zacoustic.core.streams.routing import ROUTING_STREAM_ID
from zacoustic.core.streams.status import STATUS_STREAM_ID
from zacoustic.core.transport.objects.code.code import Fragments
from zacoustic.core.transport.objects.manifest import encode_object, with_age
from zacoustic.core.wire import carry
from zacoustic.core.wire.access import ANYBODY, NOBODY, ClockTime, Turn
from zacoustic.core.wire.agreement import (
    ASSURED,
    PROVISIONAL,
    WIRE_VERSION,
    Ask,
    Confirm,
    Hello,
    TableRow,
    Tag,
)
from zacoustic.core.wire.calls import NAMED, CallKind, encode_call_byte, encode_error, encode_name
from zacoustic.core.wire.controls import Extension
from zacoustic.core.wire.envelope import Envelope
from zacoustic.core.wire.frame import Control, DenseAck, Sync
from zacoustic.core.wire.goals import (
    REMINDER,
    UNKNOWN_RESULT,
    GoalRefusal,
    Operation,
    encode_cancel,
    encode_head,
    encode_result,
)
from zacoustic.core.wire.numbers import Ack
from zacoustic.core.wire.objects import (
    NO_FRAGMENT,
    WITHDRAWN,
    Complete,
    Fragment,
    Headless,
    Lacks,
    ListenHint,
    Reason,
    Refused,
)
from zacoustic.core.wire.routing import RoutingKind, RoutingRequest
from zacoustic.testing.virtual import VirtualNetwork

VECTORS = Path(__file__).parent / "wire_native.json"


class Vector(msgspec.Struct, frozen=True, omit_defaults=True):
    """One sequence of bytes and what it says."""

    name: str
    hex: str
    meaning: str
    table: str = ""
    """The table of both ends, by its name in `TABLES`."""
    source: int = 0
    """Address of the sender; 0: it is no frame."""
    destination: int = 0
    """Address of the receiver, or 255."""
    after: tuple[str, ...] = ()
    """Vectors of the same source that came before; a dense block refers to them."""
    link: dict[str, bool] = {}
    """What the link brings, if the envelope is not empty."""
    fields: list[Fields] = []
    """The controls and records of the frame, in its order."""


class Sent(msgspec.Struct, frozen=True):
    """A frame, and its way."""

    data: bytes
    source: int
    destination: int
    table: str = "base"


def vectors() -> Iterator[Vector]:
    """Yield all vectors in their order."""
    yield from _controls()
    yield from _topics()
    yield from _calls()
    yield from _envelopes()
    yield _digest("digest_of_table", "base", 0, "digest of the table of these vectors")
    for stream in TABLES["base"]:
        name = f"digest_of_stream_{stream.stream_id}"
        yield _digest(name, "base", stream.stream_id, f"digest of its stream {stream.stream_id}")
    yield from _objects()
    yield from _access()
    yield from _reliable()
    yield from _goals()
    yield from _orders()
    yield from _status()
    yield from _subscriptions()
    yield from _dense()
    yield from _packed_bytes()
    yield from _together()
    yield from _routing()
    yield from _carried()
    yield from _keys()
    yield from _later()


def _vector(name: str, frame: Sent, meaning: str, *, reader: Reader | None = None) -> Vector:
    reader = reader or Reader(TABLES[frame.table])
    return Vector(
        name=name,
        hex=frame.data.hex(),
        meaning=meaning,
        table=frame.table,
        source=frame.source,
        destination=frame.destination,
        fields=reader.read(frame.data, frame.source, frame.destination),
    )


def _to_all(records: bytes) -> Sent:
    return Sent(records, 1, BROADCAST)


def _to_server(records: bytes, table: str = "base") -> Sent:
    """Return a frame from node 1, which is the client of all services."""
    return Sent(records, 1, 2, table)


def _to_client(records: bytes, table: str = "base") -> Sent:
    return Sent(records, 2, 1, table)


def _digest(name: str, table_name: str, stream_id: int, meaning: str) -> Vector:
    """Return the digest of a stream, or with the id 0 of the table."""
    known = TABLES[table_name]
    digest = known.by_id(stream_id).digest if stream_id else known.digest
    said: Fields = {"digest_of": f"stream {stream_id}" if stream_id else "table"}
    return Vector(name, digest.hex(), meaning, table=table_name, fields=[said])


def _controls() -> Iterator[Vector]:
    digest = bytes.fromhex("a1b2c3d4")
    hello = Hello(WIRE_VERSION, 0x1234, digest).encode()
    yield _vector("hello", _to_all(hello), "HELLO: version 2, epoch 1234, digest a1b2c3d4")
    yield _vector("tag", _to_all(Tag(0x1234).encode()), "TAG: epoch 1234")
    confirm = Confirm(2, 0x1234).encode()
    yield _vector("confirm", _to_all(confirm), "CONFIRM: epoch 1234 of node 2")
    assured = Confirm(ASSURED, 0x1234).encode()
    meaning = "CONFIRM: epoch 1234 of the destination, which has confirmed the sender"
    yield _vector("confirm_assured", _to_server(assured), meaning)
    provisional = Tag(0x1234).encode() + Confirm(PROVISIONAL, 0x5678).encode()
    meaning = (
        "TAG: epoch 1234; a provisional confirm for epoch 5678 of the destination, "
        "whose table the sender has"
    )
    yield _vector("confirm_provisional", _to_server(provisional), meaning)
    yield _vector("ask_hello", _to_all(Ask(2, 0).encode()), "ASK: node 2, its HELLO")
    yield _vector("ask_row", _to_all(Ask(2, 10).encode()), "ASK: node 2, its row of stream 10")
    row = TableRow(0x1234, 10, digest).encode()
    yield _vector("table_row", _to_all(row), "TABLE: epoch 1234, stream 10, digest a1b2c3d4")


def _access() -> Iterator[Vector]:
    turn = Turn(3, NS_PER_S).encode()
    yield _vector("turn", _to_all(turn), "TURN: node 3 may speak for 1 s")
    back = Turn(NOBODY, 0).encode()
    yield _vector("turn_back", _to_all(back), "TURN: the turn is given back")
    pause = Turn(ANYBODY, 284 * NS_PER_S // 100).encode()
    meaning = "TURN: a listen window begins 2.84 s after the beginning of this frame"
    yield _vector("turn_pause", _to_all(pause), meaning)
    new_year = ClockTime(1_767_225_600 * NS_PER_S, 2 * NS_PER_S // 1000).encode()
    yield _vector("clock", _to_all(new_year), "CLOCK: 2026-01-01 00:00 UTC, wrong by 2 ms at most")


def _objects() -> Iterator[Vector]:
    manifest, coded = encode_object(
        12, (2,), "image/png", bytes(range(100)), lineage=0x1234, number=7
    )
    whole = Fragments(coded, 60)
    for name, call, index, meaning in (
        (
            "fragment_first",
            ListenHint.NONE,
            0,
            "of object 5: stream 12, lineage 1234, number 7, instance 2, image/png, 100 bytes",
        ),
        (
            "fragment_last",
            ListenHint.ANSWER,
            1,
            "the last source fragment, which calls for an answer",
        ),
        (
            "fragment_repair",
            ListenHint.WINDOW,
            2,
            "a repair fragment, seed 0; a listen window follows",
        ),
    ):
        record = Fragment(5, call, index, whole.fragment(index)).encode()
        yield _vector(name, _to_server(record), f"FRAGMENT: {meaning}")
    _, old = encode_object(
        12, (2,), None, bytes(range(100)), lineage=0x1234, number=8, has_age=True
    )
    first = with_age(Fragments(old, 60).fragment(0), 42)
    record = Fragment(6, ListenHint.NONE, 0, first).encode()
    meaning = "of object 6: as it begins, the object is 4.2 s old"
    yield _vector("fragment_aged", _to_server(record), f"FRAGMENT: {meaning}")
    for name, about, meaning in (
        ("fragment_withdrawn", WITHDRAWN, "object 5 is withdrawn"),
        ("fragment_turn", manifest.digest[:4], "no sample before object 5 will come"),
    ):
        record = Fragment(5, ListenHint.ANSWER, NO_FRAGMENT, about).encode()
        yield _vector(name, _to_server(record), f"FRAGMENT: {meaning}")
    for name, feedback, meaning in (
        (
            "feedback_lacks",
            Lacks(5, 3, (12, 0, 255)),
            "object 5 lacks 12 of block 3, 255 of block 5",
        ),
        ("feedback_waits", Lacks(5, 3, (0,)), "all 3 blocks of object 5 are there, it waits"),
        ("feedback_complete", Complete(5, manifest.digest[:4]), "object 5 is complete"),
        ("feedback_refused", Refused(5, Reason.TOO_LARGE), "object 5 is too large"),
        ("feedback_headless", Headless(5, 300), "300 fragments of object 5, no manifest"),
    ):
        yield _vector(name, _to_client(feedback.encode()), f"FEEDBACK: {meaning}")


class _Pair:
    """Two nodes that have confirmed each other, and the frames that they send.

    Args:
        confirmed: Whether they have.
        table: The table of both.
    """

    def __init__(self, *, confirmed: bool = True, table: str = "base") -> None:
        self.frames: dict[int, list[Sent]] = {1: [], 2: []}
        self._table = table
        nodes = tuple(NodeSpec(address=each, position=(0.0, 0.0, 0.0)) for each in (1, 2))
        scenario = Scenario(nodes=nodes, profile="ideal", channel="none")
        self.network = VirtualNetwork(scenario, TABLES[table], trace=self._note)
        if confirmed:
            for address in (1, 2, 1, 2):
                self.network.publish(address, 11, b"")
                self.network.run()

    def _note(self, record: TraceRecord) -> None:
        if record.what == "transmit":
            sent = Sent(bytes.fromhex(record.frame), record.node, record.peer, self._table)
            self.frames[record.node].append(sent)

    def frame(
        self, node: int, *commands: Callable[[Engine, int], object], for_s: float = 1e-4
    ) -> Sent:
        """Give commands to a node in one instant; return the frame that it sends.

        Args:
            node: Its address.
            commands: What it is to do.
            for_s: How long it then has, s.
        """
        self.frames[node].clear()
        self.network.apply(node, lambda engine, now: [command(engine, now) for command in commands])
        # Longer, and ends that answer at once would ask each other a million times.
        self.network.run(until_s=self.network.now / NS_PER_S + for_s)
        return self.frames[node][0]


_STEP_S: Final = 50e-6
"""A dozen round trips of the ideal modem."""


def _reliable() -> Iterator[Vector]:
    pair = _Pair(table="reliable")
    order = partial(_publish, 30, b"dive")
    first = pair.frame(1, order)
    yield _vector("reliable_first", first, "SYNC: lineage 1, floor 0; sample 0 of stream 30: dive")
    answer = pair.frames[2][-1]
    yield _vector("ack_sync", answer, "SYNC: lineage 1, expected 1; ACK: expected 1")
    pair.network.run(until_s=pair.network.now / NS_PER_S + 60)
    pair.frame(1, order)
    second = pair.frame(1, order)
    yield _vector("reliable_sample", second, "sample 2 of stream 30: dive")
    answer = pair.frames[2][-1]
    yield _vector("ack", answer, "ACK to the destination: of stream 30, number 3 is expected")
    pair.frames[1].clear()
    begin_s = pair.network.now / NS_PER_S
    for step in range(3):
        pair.network.at(begin_s + step * _STEP_S, partial(pair.network.publish, 1, 30, b"dive"))
    pair.network.run(until_s=begin_s + 1)
    third = pair.frames[1][-1]
    yield _vector("reliable_in_rhythm", third, "sample 5 of stream 30, in rhythm: dive")
    gone = pair.frame(
        1, lambda engine, now: engine.publish(31, None, now, instance=(2,), delete=True)
    )
    yield _vector("reliable_delete", gone, "SYNC; fleet/shore/log/sonar is deleted, number 0")
    head = bytes((Control.ACK, 30))
    held = _to_client(head + Ack(200, 0b1000_0000_0101).encode(), "reliable")
    yield _vector("ack_holding", held, "ACK: 200 is expected (48), and 201, 203 and 212 are held")
    asks = _to_client(head + Ack(0, knows=False).encode(), "reliable")
    yield _vector("ack_asking", asks, "ACK: the lineage is not known")
    acknowledged = bytes((Control.ACK, 1, 31, 2)) + Ack(5).encode()
    broadcast = Sent(acknowledged, 2, BROADCAST, "reliable")
    yield _vector("ack_broadcast", broadcast, "ACK to node 1, in a broadcast frame: sonar, 5")
    for stream_id in (30, 31):
        name = f"digest_of_stream_{stream_id}"
        meaning = f"digest of the reliable stream {stream_id}"
        yield _digest(name, "reliable", stream_id, meaning)


def _publish(stream_id: int, value: bytes, engine: Engine, now: int) -> int:
    return engine.publish(stream_id, value, now)


def _topics() -> Iterator[Vector]:
    pair = _Pair()
    nav = pair.frame(2, lambda engine, now: engine.publish(10, NAV_VALUE, now))
    yield _vector("sample_typed", nav, "Nav 45.4, 12.3, 271.5, survey: id and CBOR by position")
    raw = pair.frame(2, lambda engine, now: engine.publish(11, b"hello", now))
    yield _vector("sample_opaque", raw, "opaque sample of stream 11: id and payload")
    aged = pair.frame(
        2, lambda engine, now: engine.publish(12, b"old", now, queued_at=now - 4_200_000_000)
    )
    yield _vector("sample_aged", aged, "sample of stream 12 that waited 4.2 s")
    for name, ago_s, waited in (
        ("sample_six_hours_old", 21_600, "six hours, as near as its code says"),
        ("sample_too_old", 31 * 86_400, "more than 30 days"),
    ):
        made_at = pair.network.now - ago_s * NS_PER_S
        made = pair.frame(
            2,
            lambda engine, now: engine.publish(12, b"old", now, queued_at=made_at),  # noqa: B023
        )
        yield _vector(name, made, f"sample of stream 12 that waited {waited}")
    unknown = pair.frame(2, lambda engine, now: engine.publish(12, b"old", now, is_dated=False))
    yield _vector("sample_of_unknown_age", unknown, "sample of stream 12 of unknown age")
    wild = pair.frame(2, lambda engine, now: engine.publish(13, b"\x01", now, instance=(2,)))
    yield _vector("sample_wildcard", wild, "fleet/auv1/sonar = 01")
    gone = pair.frame(
        2, lambda engine, now: engine.publish(13, None, now, instance=(0,), delete=True)
    )
    yield _vector("delete", gone, "fleet/auv1/ctd is deleted")
    text = pair.frame(2, lambda engine, now: engine.publish(11, b"hi", now, encoding="text/plain"))
    yield _vector("sample_encoding", text, "sample of stream 11 as text/plain")
    odd = pair.frame(2, lambda engine, now: engine.publish(11, b"hi", now, encoding="x/y"))
    yield _vector("sample_encoding_spelled", odd, "sample of stream 11 as x/y")
    both = pair.frame(
        2,
        lambda engine, now: engine.publish(11, b"raw", now),
        lambda engine, now: engine.publish(10, NAV_VALUE, now),
    )
    yield _vector(
        "two_samples", both, "Nav shows its end, so it needs no LEN before the opaque one"
    )
    opaque = pair.frame(
        2,
        lambda engine, now: engine.publish(11, b"one", now),
        lambda engine, now: engine.publish(21, b"two", now),
    )
    yield _vector("two_opaque", opaque, "two opaque samples: LEN for the first")
    new = _Pair(confirmed=False)
    new.network.set_link(1, up=False)
    first = new.frame(
        2,
        lambda engine, now: engine.publish(10, NAV_VALUE, now),
        lambda engine, now: engine.publish(11, b"raw", now),
    )
    yield _vector("first_frame", first, "HELLO, then LEN before every record but the last")
    second = new.frame(2, lambda engine, now: engine.publish(11, b"raw", now))
    yield _vector("second_frame", second, "a broadcast to nodes that have not confirmed: TAG")


def _calls() -> Iterator[Vector]:
    pair = _Pair()
    request = pair.frame(1, lambda engine, now: engine.call(20, b"\x01", now))
    yield _vector("request", request, "request 01, call 0 of stream 20")
    response = pair.frame(2, lambda engine, now: engine.reply(_call(pair), b"ok", now))
    yield _vector("response", response, "response to it: ok")
    pair.frame(1, lambda engine, now: engine.call(20, b"\x01", now))
    failure = CallFailure.HANDLER
    error = pair.frame(
        2, lambda engine, now: engine.reply_error(_call(pair), failure, "no arm", now)
    )
    yield _vector("error", error, "call 1 of stream 20 failed: the handler says 'no arm'")
    pair = _Pair()
    pair.frame(1, lambda engine, now: engine.call(20, b"\x01", now))
    has_request = pair.frames[2][-1]
    yield _vector("call_confirm_request", has_request, "the server has the request of call 0")
    pair = _Pair()
    pair.frame(1, lambda engine, now: engine.call(20, b"\x01", now))
    pair.frame(2, lambda engine, now: engine.reply(_call(pair), b"ok", now))
    has_answer = pair.frames[1][-1]
    yield _vector("call_confirm_answer", has_answer, "the client has the answer to call 0")
    for kind, payload, what in (
        (CallKind.CONFIRM, b"", "confirm"),
        (CallKind.RESPONSE, b"ok", "response"),
        (CallKind.ERROR, encode_error(CallFailure.UNKNOWN, ""), "error"),
    ):
        head = bytes((20, encode_call_byte(NAMED, 5))) + encode_name(kind, 0x1234)
        meaning = f"from the server: named {what}, call 5 of epoch 1234, of stream 20"
        yield _vector(f"named_{what}", _to_client(head + payload), meaning)


def _goals() -> Iterator[Vector]:
    pair = _Pair(table="action")
    goal = pair.frame(1, lambda engine, now: engine.actions.send_goal(40, NAV_VALUE, now))
    yield _vector("goal", goal, "GOAL 0 of stream 40: Nav 45.4, 12.3, 271.5, survey")
    key = GoalKey(1, 1, 40, 0)
    accepted = pair.frame(2, lambda engine, now: engine.actions.accept(key, now))
    yield _vector("goal_accepted", accepted, "from the server: goal 0 is ACCEPTED")
    near = pair.frame(2, lambda engine, now: engine.actions.publish_feedback(key, b"near", now))
    yield _vector("goal_feedback", near, "FEEDBACK of goal 0: near")
    # Answered before it is repeated: a repetition begins with HELLO, and answers to that name.
    cancel = pair.frame(
        1, lambda engine, now: engine.actions.cancel_goal(key, now), for_s=_STEP_S / 10
    )
    yield _vector("goal_cancel", cancel, "CANCEL goal 0")
    ends = pair.frame(2, lambda engine, now: engine.actions.answer_cancel(key, now, accepted=True))
    yield _vector("goal_cancel_accepted", ends, "from the server: goal 0 will end")
    status = GoalStatus.CANCELED
    result = pair.frame(2, lambda engine, now: engine.actions.finish(key, status, b"up", now))
    yield _vector("goal_result", result, "RESULT of goal 0: canceled, with up")
    confirm = pair.frames[1][-1]
    second = pair.network.apply(1, lambda engine, now: engine.actions.send_goal(40, NAV_VALUE, now))
    pair.network.run(until_s=pair.network.now / NS_PER_S + _STEP_S)
    pair.network.apply(2, lambda engine, now: engine.actions.accept(second, now))
    pair.network.run(until_s=pair.network.now / NS_PER_S + _STEP_S)
    status = GoalStatus.SUCCEEDED
    result = pair.frame(2, lambda engine, now: engine.actions.finish(second, status, b"up", now))
    yield _vector("goal_succeeded", result, "SUCCEEDED: RESULT of goal 1: succeeded, with up")
    yield _vector("goal_confirm", confirm, "from the client: it has the result of goal 0")
    for name, operation, epoch, payload, meaning in (
        (
            "goal_refused",
            Operation.REFUSED,
            None,
            GoalRefusal(GoalFailure.REJECTED, "too deep").encode(),
            "goal 5 is REFUSED: rejected: too deep",
        ),
        (
            "goal_cancel_refused",
            Operation.REFUSED,
            None,
            GoalRefusal(GoalFailure.CANCEL_REFUSED, "").encode(),
            "the cancel of goal 5 is REFUSED",
        ),
        (
            "goal_cancel_again",
            Operation.CANCEL_AGAIN,
            None,
            encode_cancel(1)[1],
            "from the client: CANCEL goal 5, attempt 1",
        ),
        (
            "goal_cancel_again_refused",
            Operation.REFUSED,
            None,
            GoalRefusal(GoalFailure.CANCEL_REFUSED, "too deep", 1).encode(),
            "the cancel of goal 5 is REFUSED, attempt 1: too deep",
        ),
        (
            "goal_without_result",
            Operation.RESULT,
            None,
            encode_result(GoalStatus.ABORTED, None),
            "RESULT of goal 5: aborted, without a result",
        ),
        ("goal_unknown", Operation.RESULT, None, UNKNOWN_RESULT, "RESULT of goal 5: unknown"),
        ("goal_reminder", Operation.RESULT, None, REMINDER, "has RESULT of goal 5 arrived?"),
        (
            "goal_claim",
            Operation.CLAIM,
            0x1234,
            b"",
            "FORMER: from the client: CLAIM of goal 5 of epoch 1234",
        ),
        (
            "goal_former_result",
            Operation.RESULT,
            0x1234,
            encode_result(GoalStatus.SUCCEEDED, b"up"),
            "FORMER: RESULT of goal 5 of epoch 1234: succeeded, with up",
        ),
        (
            "goal_former_succeeded",
            Operation.SUCCEEDED,
            0x1234,
            b"up",
            "FORMER: the same in a byte less: SUCCEEDED",
        ),
    ):
        record = b"\x28" + encode_head(operation, 5, epoch) + payload
        from_client = operation in (Operation.CLAIM, Operation.CANCEL_AGAIN)
        way = _to_server if from_client else _to_client
        yield _vector(name, way(record, "action"), meaning)
    yield _digest("digest_of_stream_40", "action", 40, "digest of the action, stream 40")


def _orders() -> Iterator[Vector]:
    pair = _Pair()
    for name, order, meaning, answer in (
        ("ask", RemoteCommand(), "what holds?", "node 2 transmits"),
        (
            "silence",
            RemoteCommand(kind=CommandKind.SILENCE, for_s=1800.0),
            "silence for 1800 s, command 1",
            "node 2 is silent, by a command, for 1800 s",
        ),
        ("resume", RemoteCommand(kind=CommandKind.RESUME), "resume, command 2", "node 2 transmits"),
        (
            "tune",
            RemoteCommand(
                kind=CommandKind.OVERRIDE,
                stream_id=11,
                on=False,
                min_interval_s=10.0,
                priority=Priority.BACKGROUND,
            ),
            "stream 11 is off, every 10 s at most, background, command 3",
            "so it is; node 2 transmits",
        ),
        (
            "reset",
            RemoteCommand(kind=CommandKind.RESET, stream_id=20),
            "stream 20 as node 2 is configured, command 4",
            "refused: stream 20 is no topic",
        ),
    ):
        pair.frames[2].clear()
        frame = pair.frame(1, partial(_order, order))
        yield _vector(f"order_{name}", frame, f"HELLO; call for node 2: {meaning}")
        said = pair.frames[2][0]
        yield _vector(f"order_{name}_answer", said, f"HELLO; named answer of node 2: {answer}")
    confirm = pair.frames[1][-1]  # whatever was asked again before
    yield _vector("order_confirm", confirm, "the client has the answer to call 4 of node 2")
    meaning = "digest of the stream of remote commands"
    yield _digest("digest_of_stream_175", "base", COMMANDS_STREAM_ID, meaning)


def _order(order: RemoteCommand, engine: Engine, now: int) -> int:
    return engine.commands.send(2, order, now)


def _status() -> Iterator[Vector]:
    pair = _Pair()
    at_s = 1_750_000_000
    pair.network.apply(2, lambda engine, now: engine.handle_clock(at_s * NS_PER_S - now, 0, now))
    pair.frames[2].clear()
    frame = pair.frame(1, lambda engine, now: engine.status.ask(2, now, timeout_s=30))
    yield _vector("status", frame, "HELLO; call for node 2: its status, call 0")
    said = pair.frames[2][0]
    meaning = f"journal kept, first start, UTC {at_s} s, exact"
    yield _vector("status_answer", said, f"HELLO; named answer of node 2: {meaning}")
    meaning = "digest of the stream of the status"
    yield _digest("digest_of_stream_174", "base", STATUS_STREAM_ID, meaning)


def _routing() -> Iterator[Vector]:
    pair = _Pair()
    request = RoutingRequest(kind=RoutingKind.HEARD, run=7)
    pair.frames[2].clear()
    frame = pair.frame(1, lambda engine, now: engine.routing.send(2, request, now, timeout_s=30))
    yield _vector("routing_heard", frame, "HELLO; call for node 2: what was heard of run 7")
    said = pair.frames[2][0]
    yield _vector("routing_heard_answer", said, "HELLO; named answer of node 2: nothing")
    meaning = "digest of the stream of commands about routes"
    yield _digest("digest_of_stream_172", "base", ROUTING_STREAM_ID, meaning)


_SHORE, _AUV, _GLIDER = 1, 2, 3


def _carried() -> Iterator[Vector]:
    known = TABLES["carried"]
    track, deep = known.by_id(60), known.by_id(61)
    of_track = carry.Bundle(_AUV, _SHORE, 60, (), 0x1234)
    of_sonar = carry.Bundle(_AUV, _SHORE, 61, (2,), 0xBEEF)
    nav = carry.Envelope(
        bundle=of_track, number=0x010005, floor=0x010002, digest=track.digest, life_s=86_400.0,
        hops=1, payload=track.codec.encode(NAV_VALUE),
    )  # fmt: skip
    later = msgspec.structs.replace(nav, life_s=40_000.0, hops=0)
    text = carry.Envelope(
        bundle=of_sonar, number=7, floor=None, digest=deep.digest, life_s=0.0,
        encoding="text/plain", payload=b"ping",
    )  # fmt: skip
    gone = msgspec.structs.replace(
        text, number=8, floor=8, encoding=None, payload=b"", deleted=True, life_s=900.0, hops=1
    )
    sent = partial(_carried_sample, 0x4321)
    for name, source, destination, message, meaning in (
        ("carried_envelope", _AUV, _GLIDER, nav, "node 2 gives 3 sample 65541 of auv1/track for 1"),
        ("carried_onwards", _GLIDER, _SHORE, later, "the custodian hands it to node 1, 640 min on"),
        ("carried_direct", _AUV, _SHORE, text, "straight: text of deep/sonar, floor unknown"),
        ("carried_delete", _AUV, _GLIDER, gone, "deep/sonar is deleted, number 8, for 15 min"),
    ):
        octets = carry.encode_envelope(message, source, destination)
        frame = sent(octets, source, destination)
        yield _vector(name, frame, f"SYNC; sample of stream {CARRY_STREAM_ID}: {meaning}")
    for name, source, destination, answer, meaning in (
        ("carried_receipt", _SHORE, _GLIDER, carry.Receipt(of_track, 0x010006),
         "node 1 has auv1/track before 65542"),
        ("carried_refusal", _GLIDER, _AUV, carry.CarryRefusal(of_sonar, 8),
         "node 3 does not keep 8 of deep/sonar"),
        ("carried_refusal_final", _SHORE, _AUV, carry.CarryRefusal(of_sonar, 8, is_final=True),
         "node 1 defines deep/{sensor} in another way"),
    ):  # fmt: skip
        frame = sent(carry.encode_answer(answer), source, destination)
        yield _vector(name, frame, f"SYNC; sample of stream {CARRY_STREAM_ID}: {meaning}")
    for stream_id in (60, 61):
        yield _digest(
            f"digest_of_stream_{stream_id}", "carried", stream_id,
            f"digest of the carried stream {stream_id}",
        )  # fmt: skip


def _carried_sample(lineage: int, octets: bytes, source: int, destination: int) -> Sent:
    """Return the frame of a first sample of the stream of carried samples."""
    records = Sync(lineage, 0).encode() + bytes((CARRY_STREAM_ID, destination, 0)) + octets
    return Sent(records, source, destination, "carried")


PAIR_SECRET: Final = bytes(range(32, 64))
"""What the nodes 1 and 2 share in the vectors of keys."""


def _keys() -> Iterator[Vector]:
    hello = Hello(WIRE_VERSION, 1, TABLES["base"].digest).encode()
    info = b"carry" + bytes((3, 1, 2))
    pair_key = HKDFExpand(hashes.SHA256(), 32, info).derive(PAIR_SECRET)
    wrapped = aes_key_wrap(pair_key, bytes(range(32)))
    head = bytes((KEYS_STREAM_ID, 2, encode_call_byte(CallKind.REQUEST, 0)))
    request = hello + head + encode_delivery(3, wrapped)
    meaning = "HELLO; call for node 2: the wrapped secret of the broadcasts of node 3"
    yield _vector("keys", _to_server(request), meaning)
    name = encode_name(CallKind.RESPONSE, 1)
    said = bytes((KEYS_STREAM_ID, 2, encode_call_byte(NAMED, 0))) + name
    meaning = "HELLO; named answer of node 2: it has stored it"
    yield _vector("keys_answer", _to_client(hello + said), meaning)
    yield _digest("digest_of_stream_173", "base", KEYS_STREAM_ID, "digest of the stream of keys")


def _later() -> Iterator[Vector]:
    """Say what only a later page lists."""
    refused = Refused(5, 200).encode()
    yield _vector("feedback_refused_later", _to_client(refused), "FEEDBACK: a refusal, unlisted")
    error = bytes((20, encode_call_byte(CallKind.ERROR, 1), 200)) + b"tired"
    yield _vector("error_later", _to_client(error), "error, call 1: an unlisted failure is 1")
    error = bytes((20, encode_call_byte(CallKind.ERROR, 1), 1, 0xFF))
    yield _vector("error_no_text", _to_client(error), "error, call 1: handler failed, no UTF-8")


def _subscriptions() -> Iterator[Vector]:
    pair = _Pair(table="on_demand")
    message = pair.frame(1, lambda engine, now: engine.subscriptions.want(50, now))
    yield _vector("subscribe", message, "SUBSCRIBE: of the streams 48…55 50 is wanted, version 1")
    answer = pair.frames[2][-1]
    yield _vector("subscribe_answer", answer, "SUBSCRIBE: the answer to it")
    message = pair.frame(1, lambda engine, now: engine.subscriptions.want(50, now, ()))
    yield _vector(
        "unsubscribe", message, "SUBSCRIBE: of the streams 48…55 none is wanted, version 2"
    )
    meaning = "digest of the on-demand stream 50"
    yield _digest("digest_of_stream_50", "on_demand", 50, meaning)


def _dense() -> Iterator[Vector]:
    mark = _to_client(DenseAck(0, 0x1234).encode(), "dense")
    yield _vector("dense_ack", mark, "ACK to the destination: its dense block 1234 is held")
    mark = Sent(DenseAck(1, 0x3FFF).encode(), 2, BROADCAST, "dense")
    meaning = "ACK to node 1, in a broadcast frame: its dense block 3fff is held"
    yield _vector("dense_ack_broadcast", mark, meaning)

    def publish(stream_id: int, **changed: object) -> Callable[[Engine, int], object]:
        value = {**NAV_VALUE, **changed}
        return lambda engine, now: engine.publish(stream_id, value, now)

    first = _Pair(confirmed=False, table="dense").frame(1, publish(10))
    meaning = "HELLO; an independent dense block: Nav 45.4, 12.3, 271.5, survey"
    yield _vector("dense_first", first, meaning)
    pair = _Pair(table="dense")
    several = pair.frame(
        1, publish(10), publish(10, depth=12.4), publish(50),
        lambda engine, now: engine.publish(11, b"raw", now),
    )  # fmt: skip
    meaning = (
        "LEN before the opaque sample; an independent dense block: two Nav of stream 10, one of 50"
    )
    reader = Reader(TABLES["dense"])
    yield _vector("dense_several", several, meaning, reader=reader)
    acknowledging = pair.frame(2, lambda engine, now: engine.publish(11, b"", now))
    yield _vector("dense_acknowledged", acknowledging, "ACK to node 1; an opaque sample of nothing")
    referring = pair.frame(1, publish(10, heading=272.0))
    meaning = "a dense block that refers to it: Nav, heading 272"
    vector = _vector("dense_referring", referring, meaning, reader=reader)
    yield msgspec.structs.replace(vector, after=("dense_several",))
    for stream_id in (10, 50):
        name = f"digest_of_dense_stream_{stream_id}"
        yield _digest(name, "dense", stream_id, f"digest of the dense stream {stream_id}")


def _packed_bytes() -> Iterator[Vector]:
    pair = _Pair(table="bytes")

    def publish(stream_id: int, octets: bytes) -> Sent:
        return pair.frame(1, lambda engine, now: engine.publish(stream_id, octets, now))

    line = b"INF battery: 25.9 V, 2.8 A, 79 %"
    yield _vector("packed_text", publish(51, line), f"sample of stream 51, packed: {line.decode()}")
    octets = bytes.fromhex("8f03ff77")
    yield _vector("packed_octets", publish(51, octets), "sample of stream 51: 8f03ff77")
    octets = bytes.fromhex("c803ff77")
    yield _vector("packed_octets_marked", publish(51, octets), "sample of stream 51: c803ff77")
    meaning = f"an independent dense block: {line.decode()}"
    yield _vector("dense_text", publish(52, line), meaning)
    for stream_id in (51, 52):
        name = f"digest_of_bytes_stream_{stream_id}"
        meaning = f"digest of the stream {stream_id} of packed bytes"
        yield _digest(name, "bytes", stream_id, meaning)


def _together() -> Iterator[Vector]:
    """What the others do not have: several parts of the grammar in one frame."""
    point = TABLES["kinds"].by_id(3).codec.encode({"x": 1.5, "y": -2.5})
    sync = Sync(0x1234, 0x010005).encode()
    sample = sync + bytes((3, 1, 0, 0x07, 42)) + point
    meaning = "SYNC; stream 3, wildcards 1 and 0, number 7, 4.2 s old: a typed sample"
    yield _vector("reliable_wildcards_aged", Sent(sample, 1, 2, "kinds"), meaning)
    meaning = "stream 11, wildcard 1, publisher 1: raw"
    yield _vector("latched_publisher", Sent(b"\x0b\x01\x01raw", 1, BROADCAST, "latched"), meaning)
    ack = sync + bytes((Control.ACK, 31, 2)) + Ack(5, 0b101).encode()
    meaning = "SYNC: lineage 1234, 65541 is awaited; ACK: 5, and 6 and 8 are held"
    yield _vector("ack_sync_holding", _to_client(ack, "reliable"), meaning)
    known = TABLES["reliable"].digest
    head = Hello(WIRE_VERSION, 2, known).encode() + Confirm(1, 1).encode()
    acked = bytes((Control.LEN, 3, Control.ACK, 30)) + Ack(3).encode()
    frame = head + acked + bytes((11,)) + b"raw"
    meaning = "HELLO, CONFIRM, LEN before an ACK, a sample to the end"
    yield _vector("hello_len_ack", _to_client(frame, "reliable"), meaning)
    several = Extension(0xE1, b"\x01\x02").encode() + bytes((0, 11)) + b"raw"
    meaning = "an extension E1 of two bytes, padding, a sample"
    yield _vector("extension_padding", _to_all(several), meaning)
    link = LinkCapabilities(
        mtu_bytes=300, bit_rate_bps=1000, addressed=False, checked=False, framed=False
    )
    records = bytes((11,)) + bytes(range(1, 256))
    meaning = "a byte stream: 256 bytes of records, addresses, CRC-32, COBS in two pieces"
    plain = _vector("byte_stream_long", Sent(records, 2, 1), meaning)
    yield msgspec.structs.replace(
        plain,
        hex=Envelope(link, 2).wrap(records, 1).hex(),
        link={"addressed": False, "checked": False, "framed": False},
    )


def _call(pair: _Pair) -> CallKey:
    """Return the call that arrived last."""
    events = (event for _, event in reversed(pair.network.events))
    return next(event.call for event in events if isinstance(event, RequestReceived))


def _envelopes() -> Iterator[Vector]:
    link = LinkCapabilities(mtu_bytes=64, bit_rate_bps=1000)
    records = bytes.fromhex("0b00ff")
    unaddressed = msgspec.structs.replace(link, addressed=False)
    unchecked = msgspec.structs.replace(link, checked=False)
    stream = msgspec.structs.replace(unaddressed, checked=False, framed=False)
    for name, meaning, capabilities in (
        ("unaddressed", "record 0b00ff from 2 to 1: destination and source", unaddressed),
        ("unchecked", "the same on a link that addresses: CRC-32", unchecked),
        ("byte_stream", "the same on a byte stream: addresses, CRC-32, COBS", stream),
    ):
        envelope = Envelope(capabilities, 2)
        plain = _vector(name, Sent(records, 2, 1), meaning)
        yield msgspec.structs.replace(
            plain,
            hex=envelope.wrap(records, 1).hex(),
            link={
                "addressed": capabilities.addressed,
                "checked": capabilities.checked,
                "framed": capabilities.framed,
            },
        )


def text(made: Iterable[Vector]) -> str:
    """Return the file of vectors."""
    return lines(msgspec.to_builtins(list(made))) + "\n"


if __name__ == "__main__":
    known = json.loads(VECTORS.read_text(encoding="utf-8"))
    made = {each.name: each for each in vectors()}
    changed = [
        name
        for name, octets in ((each["name"], each["hex"]) for each in known)
        if name not in made or made[name].hex != octets
    ]
    if changed:
        raise SystemExit(f"changed: {', '.join(changed)}; a changed vector is a changed version")
    VECTORS.write_text(text(made.values()), encoding="utf-8")
