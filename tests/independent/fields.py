"""Section 14: what a frame says, as `fields` of the vectors. Written from docs/wire.md alone."""

import math
from typing import Any

from tests.independent import (
    access,
    agreement,
    blocks,
    calls,
    carried,
    compose,
    dense,
    frame,
    goals,
    objects,
    record,
    subscriptions,
)
from tests.independent.agreement import Ask, Confirm, Hello, Row, Tag
from tests.independent.cursor import Cursor
from tests.independent.record import Acknowledgement, Call, Goal, Payload, Sample, Way
from tests.independent.table import CARRIED, Action, Service, Topic

Fields = dict[str, Any]
_KINDS = {
    calls.REQUEST: "request",
    calls.RESPONSE: "response",
    calls.ERROR: "error",
    calls.CONFIRM: "confirm",
}


def of(placed: frame.Placed, way: Way) -> Fields:
    """Return what one control or record says."""
    item = placed.item
    if isinstance(item, Hello | Tag | Confirm | Ask | Row):
        return _agreement(item, way)
    if isinstance(item, Sample):
        return _sample(item, way)
    if isinstance(item, Acknowledgement):
        return _acknowledgement(item, way)
    if isinstance(item, Call):
        return _call(item, way)
    if isinstance(item, Goal):
        return _goal(item, way)
    if isinstance(item, objects.Fragment | objects.Feedback):
        return _object(item)
    if isinstance(item, frame.Extension):
        return {"extension": f"{item.code:02x}", "body": item.body.hex()}
    if isinstance(item, dense.Block):
        return {"dense": item.data.hex()}
    if isinstance(item, frame.Unread):
        return {"unread": placed.data.hex()}
    return _other(item, way)


def _agreement(item: agreement.Control, way: Way) -> Fields:
    if isinstance(item, Hello):
        front = {"control": "HELLO", "version": item.version}
        return {**front, "epoch": item.epoch, "digest": item.digest.hex()}
    if isinstance(item, Tag):
        return {"control": "TAG", "epoch": item.epoch}
    if isinstance(item, Ask):
        return {"control": "ASK", "node": item.node, "stream": item.stream}
    if isinstance(item, Row):
        front = {"control": "TABLE", "epoch": item.epoch, "stream": item.stream}
        return {**front, "digest": item.digest.hex()}
    special = {agreement.DESTINATION: "assured", agreement.PROVISIONAL: "provisional"}
    if not way.broadcast and item.node in special:
        node, more = way.destination, {special[item.node]: True}
    else:
        node, more = item.node, {}
    return {"control": "CONFIRM", "node": node, "epoch": item.epoch, **more}


def _other(item: frame.Item, way: Way) -> Fields:
    if isinstance(item, access.Turn):
        return {"control": "TURN", "node": item.node, "span_20ms": item.span}
    if isinstance(item, access.Clock):
        return {"control": "CLOCK", "time_100us": item.ticks, "error_ms": item.error_ms}
    if isinstance(item, dense.BlockAck):
        node = way.destination if item.node is None else item.node
        return {"control": "ACK", "node": node, "mark": f"{item.mark:04x}"}
    if isinstance(item, subscriptions.Subscribe):
        front = {"control": "SUBSCRIBE", "page": item.page, "version": item.version}
        more = {"answer": item.answer, "proved": item.proved, "heard": item.heard}
        return {**front, "streams": list(item.wanted), **more}
    raise TypeError(f"no fields for {item}")


def _object(item: objects.Fragment | objects.Feedback) -> Fields:
    if isinstance(item, objects.Fragment):
        front = {"control": "FRAGMENT", "transfer": item.number, "listen_hint": item.hint}
        front["index"] = item.index
        if item.withdraws:
            return {**front, "withdrawn": "yes"}
        return {**front, "turn_of" if item.is_turn else "data": item.data.hex()}
    front = {"control": "FEEDBACK", "transfer": item.number}
    if item.waits:
        return {**front, "kind": "waits", "blocks": item.block}
    if item.kind == objects.LACKS:
        return {**front, "kind": "lacks", "block": item.block, "lacking": list(item.missing)}
    if item.kind == objects.COMPLETE:
        return {**front, "kind": "complete", "digest": item.digest.hex()}
    if item.kind == objects.REFUSED:
        word = objects.REASONS.get(item.reason, "unlisted").replace(" ", "_")
        return {**front, "kind": "refused", "reason": item.reason, "word": word}
    return {**front, "kind": "headless", "held": item.held}


def of_block(item: dense.Block, reader: blocks.Reader) -> Fields:
    """Return what a dense block says to a reader of its source, which holds it from then on."""
    samples = []
    read, block = reader.read(item.data)
    for stream_id, whole in read:
        value, code = blocks.parts_of(whole)
        age_s = None if code is None else record.read_age(Cursor(bytes((code,))))
        samples.append({"stream": stream_id, **_age(age_s), "value": plain(value)})
    return {"dense": item.data.hex(), "samples": samples, "mark": f"{block.mark:04x}"}


def plain(value: Any) -> Any:
    """Return a value as JSON has it: bytes in hexadecimal digits."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, list):
        return [plain(one) for one in value]
    return value if not isinstance(value, float) or math.isfinite(value) else str(value)


def _said(payload: Payload, name: str | None, codec: str, way: Way) -> Fields:
    raw = compose.payload_bytes(payload, name, codec, way.table)
    return {"payload": raw.hex(), "value": plain(payload)}


def _age(age_s: float | None) -> Fields:
    if age_s is None:
        return {}
    shown = None if math.isnan(age_s) else min(age_s, 30 * 86_400.0)
    return {"age_code": record.write_age(age_s), "age_s": shown}


def _key(topic: Topic, wildcards: tuple[str, ...], node: int, way: Way) -> str:
    name = topic.name.replace("{node}", way.table.nodes.get(node, ""))
    for wildcard, value in zip(topic.wildcards, wildcards, strict=True):
        name = name.replace(f"{{{wildcard.name}}}", value)
    return name


def _sample(item: Sample, way: Way) -> Fields:
    topic = way.table.stream(item.stream)
    assert isinstance(topic, Topic)
    found: Fields = {"record": "delete" if item.deletes else "sample", "stream": item.stream}
    found["key"] = _key(topic, item.wildcards, way.source, way)
    if item.number is not None:
        found |= {"number_low": item.number, "in_rhythm": item.in_rhythm}
    if topic is CARRIED:
        assert isinstance(item.payload, bytes)
        found["carried"] = _carried(item.payload, way)
    elif item.payload is not None:
        found |= _age(item.age_s)
        found |= _said(item.payload, topic.type, topic.codec, way)
    if item.sync is not None:
        found["sync"] = {"lineage": item.sync.lineage, "floor": item.sync.number}
    if item.encoding is not None:
        found["encoding"] = item.encoding
    return found


_CARRIED = {
    carried.ENVELOPE: "envelope",
    carried.DIRECT: "direct",
    carried.RECEIPT: "receipt",
    carried.REFUSAL: "refusal",
}


def _carried(payload: bytes, way: Way) -> Fields:
    item = carried.read(payload, way.source, way.destination, way.table)
    assert carried.write(item, way.table) == payload
    topic = way.table.stream(item.stream)
    assert isinstance(topic, Topic)
    ends = {"origin": item.origin, "destination": item.destination, "stream": item.stream}
    found: Fields = {"kind": _CARRIED[item.kind], **ends}
    found["key"] = _key(topic, item.wildcards, item.origin, way)
    found |= {"lineage": item.lineage, "number": item.number}
    if item.kind in (carried.RECEIPT, carried.REFUSAL):
        return {**found, "final": item.final} if item.kind == carried.REFUSAL else found
    found |= {"digest": item.digest.hex(), "floor": item.floor}
    if item.kind == carried.ENVELOPE:
        found |= {"life_min": item.life_min, "custodians": item.more}
    if item.encoding is not None:
        found["encoding"] = item.encoding
    if item.deletes:
        return found
    return {
        **found,
        "payload": item.payload.hex(),
        "value": plain(carried.value(item, way.table)),
    }


def _acknowledgement(item: Acknowledgement, way: Way) -> Fields:
    topic = way.table.stream(item.stream)
    assert isinstance(topic, Topic)
    node = way.destination if item.node is None else item.node
    found: Fields = {"record": "ack", "stream": item.stream, "node": node}
    found["key"] = _key(topic, item.wildcards, node, way)
    if not item.holding.knows_lineage:
        return {**found, "knows_lineage": False}
    found |= {"awaited_low": item.holding.awaited, "held_beyond": list(item.holding.beyond)}
    if item.sync is not None:
        found["sync"] = {"lineage": item.sync.lineage, "awaited": item.sync.number}
    return found


def _call(item: Call, way: Way) -> Fields:
    service = way.table.stream(item.stream)
    assert isinstance(service, Service)
    answers = item.head.from_server
    server, client = (way.source, way.destination) if answers else (way.destination, way.source)
    if item.server is not None:
        server = item.server
    found: Fields = {"record": _KINDS[item.head.kind], "stream": item.stream, "server": server}
    found |= {"client": client, "call": item.head.number}
    if item.server is not None:
        found["server_in_record"] = True
    if item.head.epoch is not None:
        found["epoch_low"] = item.head.epoch
    if item.payload is None:
        return {**found, "of": "request" if answers else "answer"}
    if isinstance(item.payload, calls.Failure):
        return {**found, "failure": item.payload.code, "text": item.payload.text}
    name = service.response if answers else service.request
    return {**found, **_age(item.age_s), **_said(item.payload, name, service.codec, way)}


def _goal(item: Goal, way: Way) -> Fields:
    action = way.table.stream(item.stream)
    assert isinstance(action, Action)
    name = item.head.operation
    found: Fields = {"record": name, "stream": item.stream, "goal": item.head.number}
    if item.head.epoch is not None:
        found["former_epoch"] = item.head.epoch
    if isinstance(item.payload, goals.Refusal):
        found |= {"failure": item.payload.failure, "text": item.payload.text}
        attempt = item.payload.attempt
        return found if attempt is None else {**found, "attempt": attempt}
    if item.attempt is not None:
        found["attempt"] = item.attempt
    elif name == "CANCEL" and not item.head.from_server:
        found["attempt"] = 0
    if name == "RESULT" and item.status is not None:
        words: dict[int, Any] = {goals.UNKNOWN: "unknown", goals.REMINDER: "reminder"}
        found["status"] = words.get(item.status, item.status & ~goals.NO_RESULT_FOLLOWS)
    elif item.status is not None:
        found["status"] = item.status
    if item.payload is None:
        return found
    types = {"GOAL": action.goal, "FEEDBACK": action.feedback}
    return {**found, **_said(item.payload, types.get(name, action.result), action.codec, way)}
