"""What a frame says, as JSON: the `fields` of the vectors, made by the decoders of the engines.

Bytes are hexadecimal texts. Numbers are as the page has them; instants and spans are in its steps.
"""

from typing import Any, Final

from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.streams.carry import CARRY_STREAM_ID
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import AGE_FIELD, EVERY_NODE, Stream, StreamTable
from zacoustic.core.values.age import decode_age
from zacoustic.core.values.dense import DenseCodec, Listener
from zacoustic.core.values.payload import PayloadCodec, PayloadError
from zacoustic.core.wire import carry
from zacoustic.core.wire.access import CLOCK_TICK_NS, SPAN_STEP_NS, ClockTime, Turn
from zacoustic.core.wire.agreement import Ask, Confirm, Hello, TableRow, Tag
from zacoustic.core.wire.calls import NAMED, CallFailure, CallKind, decode_call_byte, decode_error
from zacoustic.core.wire.content import measure_content, server_of
from zacoustic.core.wire.controls import Extension, Item
from zacoustic.core.wire.frame import DenseAck, DenseBlock, Prefixes, Record, Stray, parse_frame
from zacoustic.core.wire.goals import (
    REMINDER,
    UNKNOWN_RESULT,
    Operation,
    decode_cancel,
    decode_message,
    decode_refusal,
    decode_result,
)
from zacoustic.core.wire.numbers import IN_RHYTHM, decode_ack
from zacoustic.core.wire.objects import (
    NO_FRAGMENT,
    Complete,
    Feedback,
    Fragment,
    Headless,
    Lacks,
    Reason,
    Refused,
)
from zacoustic.core.wire.subscriptions import Subscribe, streams_of

Fields = dict[str, Any]
"""One control or record."""

_MS: Final = 1_000_000
_AGAIN_REFUSED: Final = 10


class Reader:
    """Reads the frames of a fleet, one after the other.

    Args:
        table: The table of sender and receiver.
    """

    def __init__(self, table: StreamTable) -> None:
        self._table = table
        self._listeners: dict[int, Listener] = {}

    def read(self, records: bytes, source: int, destination: int) -> list[Fields]:
        """Return the controls and records of a frame, in its order.

        Args:
            records: The frame without its envelope.
            source: Address of its sender.
            destination: Address of its receiver, or 255.
        """

        def measure(stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes) -> int | None:
            stream = self._table.get(stream_id)
            if stream is None:
                raise KeyError(stream_id)
            return measure_content(stream, buffer, offset, prefixes, source)

        unicast = destination != BROADCAST
        found = parse_frame(records, measure, CONTROLS, unicast=unicast)
        return [self._item(item, source, destination) for item in found]

    def _item(self, item: Item, source: int, destination: int) -> Fields:
        match item:
            case Record():
                return self._record(item, source, destination)
            case DenseBlock(block):
                return self._dense(block, source)
            case DenseAck(address, mark):
                node = address or destination
                return {"control": "ACK", "node": node, "mark": f"{mark:04x}"}
            case Stray(reason, size_bytes):
                return {"unreadable": reason, "bytes": size_bytes}
        return _control(item, destination)

    def _dense(self, block: bytes, source: int) -> Fields:
        if source not in self._listeners:
            types = {
                stream.stream_id: stream.dense_type
                for stream in self._table
                if stream.dense_type is not None and stream.may_publish(source)
            }
            codec = DenseCodec(types, model=self._table.model, digest=self._table.digest)
            self._listeners[source] = Listener(codec)
        listener = self._listeners[source]
        decoded = listener.decode(block)
        samples = []
        for stream_id, value in decoded.samples:
            plain = {name: part for name, part in value.items() if name != AGE_FIELD}
            sample: Fields = {"stream": stream_id}
            if AGE_FIELD in value:
                sample |= _age(value[AGE_FIELD])
            sample["value"] = in_json(self._table.by_id(stream_id).dense_sample(plain))
            samples.append(sample)
        mark = listener.mark
        return {
            "dense": block.hex(),
            "samples": samples,
            "mark": None if mark is None else f"{mark:04x}",
        }

    def _record(self, record: Record, source: int, destination: int) -> Fields:
        stream = self._table.by_id(record.stream_id)
        before: Fields = {}
        prefixes = record.prefixes
        if prefixes.sync is not None:
            name = "floor" if prefixes.acknowledged is None else "awaited"
            before["sync"] = {"lineage": prefixes.sync.lineage, name: prefixes.sync.floor}
        if prefixes.encoding is not None:
            before["encoding"] = prefixes.encoding
        if isinstance(stream.spec, ServiceSpec):
            return {**_call(stream, record.content, source, destination), **before}
        if isinstance(stream.spec, ActionSpec):
            return {**_action(stream, record.content, source), **before}
        return {**self._topic(stream, record, source, destination), **before}

    def _topic(self, stream: Stream, record: Record, source: int, destination: int) -> Fields:
        prefixes, content = record.prefixes, record.content
        count = len(stream.keys.wildcards)
        instance, content = tuple(content[:count]), content[count:]
        if prefixes.acknowledged is not None:
            node = prefixes.acknowledged or destination
            found = {"record": "ack", "stream": stream.stream_id, "node": node}
            found["key"] = stream.keys.key(node, instance)
            ack = decode_ack(content)
            assert ack is not None
            if not ack.knows:
                return {**found, "knows_lineage": False}
            # From the awaited number on: bit 0 of `held` is the next but one.
            held = [1 + bit for bit in range(ack.held.bit_length()) if ack.held >> bit & 1]
            return {**found, "awaited_low": ack.expected, "held_beyond": held}
        kind = "delete" if prefixes.delete else "sample"
        found = {"record": kind, "stream": stream.stream_id}
        found["key"] = stream.keys.key(source, instance)
        if stream.qos.reliability is Reliability.RELIABLE:
            found["number_low"] = content[0] & ~IN_RHYTHM
            found["in_rhythm"] = bool(content[0] & IN_RHYTHM)
            content = content[1:]
        if prefixes.delete:
            return found
        if stream.stream_id == CARRY_STREAM_ID:
            return {**found, "carried": self._carried(content, source, destination)}
        if stream.qos.stamp is Stamp.AGE:
            found |= _age(content[0])
            content = content[1:]
        return {**found, **_value(stream.codec, content)}

    def _carried(self, content: bytes, source: int, destination: int) -> Fields:
        wildcards = {each.stream_id: len(each.keys.wildcards) for each in self._table.carried}
        said = carry.decode(content, source, destination, wildcards)
        assert said is not None
        bundle = said.bundle
        stream = self._table.by_id(bundle.stream_id)
        found: Fields = {
            "origin": bundle.origin,
            "destination": bundle.destination,
            "stream": bundle.stream_id,
            "key": stream.keys.key(bundle.origin, bundle.instance),
            "lineage": bundle.lineage,
            "number": said.number,
        }
        if isinstance(said, carry.Receipt):
            return {"kind": "receipt", **found}
        if isinstance(said, carry.CarryRefusal):
            return {"kind": "refusal", **found, "final": said.is_final}
        found |= {"digest": said.digest.hex(), "floor": said.floor}
        if carry.is_direct(content):
            found = {"kind": "direct", **found}
        else:
            minutes = int(said.life_s / carry.MINUTE_S)
            found = {"kind": "envelope", **found, "life_min": minutes, "custodians": said.hops}
        if said.encoding is not None:
            found["encoding"] = said.encoding
        return found if said.deleted else {**found, **_value(stream.codec, said.payload)}


def _control(item: Item, destination: int) -> Fields:
    match item:
        case Hello(version, epoch, digest):
            said: Fields = {"version": version, "epoch": epoch, "digest": digest.hex()}
            return {"control": "HELLO", **said}
        case Tag(epoch):
            return {"control": "TAG", "epoch": epoch}
        case Confirm(address, epoch):
            if destination != BROADCAST and address in (0, 255):
                kind = "assured" if address == 0 else "provisional"
                return {"control": "CONFIRM", "node": destination, "epoch": epoch, kind: True}
            return {"control": "CONFIRM", "node": address, "epoch": epoch}
        case Ask(address, stream_id):
            return {"control": "ASK", "node": address, "stream": stream_id}
        case TableRow(epoch, stream_id, digest):
            said = {"epoch": epoch, "stream": stream_id, "digest": digest.hex()}
            return {"control": "TABLE", **said}
        case Turn(node, span_ns):
            return {"control": "TURN", "node": node, "span_20ms": span_ns // SPAN_STEP_NS}
        case ClockTime(time_ns, error_ns):
            error_ms = None if error_ns is None else error_ns // _MS
            said = {"time_100us": time_ns // CLOCK_TICK_NS, "error_ms": error_ms}
            return {"control": "CLOCK", **said}
        case Extension(code, body):
            return {"extension": f"{code:02x}", "body": body.hex()}
        case Subscribe():
            return {
                "control": "SUBSCRIBE",
                "page": item.page,
                "version": item.version,
                "streams": list(streams_of(item.page, item.streams)),
                "answer": item.is_answer,
                "proved": item.is_kept,
                "heard": item.heard,
            }
        case Fragment(transfer, hint, index, data):
            what = {"data": data.hex()}
            if index == NO_FRAGMENT:
                what = {"turn_of": data.hex()} if data else {"withdrawn": "yes"}
            said = {"transfer": transfer, "listen_hint": int(hint), "index": index}
            return {"control": "FRAGMENT", **said, **what}
        case Lacks() | Complete() | Refused() | Headless():
            return {"control": "FEEDBACK", "transfer": item.transfer, **_feedback(item)}
    raise AssertionError(f"no fields for {item}")


def _feedback(item: Feedback) -> Fields:
    match item:
        case Lacks(_, block, lacking):
            if item.is_nothing:
                return {"kind": "waits", "blocks": block}
            return {"kind": "lacks", "block": block, "lacking": list(lacking)}
        case Complete(_, check):
            return {"kind": "complete", "digest": check.hex()}
        case Refused(_, reason):
            is_listed = reason in {*Reason}
            word = Reason(reason).name.lower() if is_listed else "unlisted"
            return {"kind": "refused", "reason": reason, "word": word}
        case Headless(_, held):
            return {"kind": "headless", "held": held}


def _call(stream: Stream, content: bytes, source: int, destination: int) -> Fields:
    assert isinstance(stream.spec, ServiceSpec)
    server, offset = server_of(stream.spec, content, 0)
    kind, number = decode_call_byte(content[offset])
    payload = content[offset + 1 :]
    is_answer = source == server
    client = destination if is_answer else source
    found: Fields = {"record": kind.name.lower(), "stream": stream.stream_id}
    found |= {"server": server, "client": client, "call": number}
    if stream.spec.server == EVERY_NODE:
        found["server_in_record"] = True
    if is_answer and kind is NAMED:
        kind = CallKind(payload[0] >> 6)
        found["record"] = kind.name.lower()
        found["epoch_low"] = payload[0] & 0x3F
        payload = payload[1:]
    if kind is CallKind.CONFIRM:
        return {**found, "of": "request" if is_answer else "answer"}
    if kind is CallKind.ERROR:
        error = decode_error(payload) or (CallFailure.HANDLER, "")  # as the engine takes it
        return {**found, "failure": int(error[0]), "text": error[1]}
    if stream.qos.stamp is Stamp.AGE:
        found |= _age(payload[0])
        payload = payload[1:]
    codec = stream.response_codec if kind is CallKind.RESPONSE else stream.codec
    return {**found, **_value(codec, payload)}


def _action(stream: Stream, content: bytes, source: int) -> Fields:
    assert isinstance(stream.spec, ActionSpec)
    from_client = source != stream.spec.server
    message = decode_message(content, from_client=from_client)
    assert message is not None
    outer = Operation(content[0] >> 5)
    former = outer is Operation.FORMER
    operation = Operation((content[3] if former else content[0]) >> 5)
    names = _FROM_CLIENT if from_client else _FROM_SERVER
    found: Fields = {"record": names[operation], "stream": stream.stream_id}
    found["goal"] = message.number
    if former:
        found["former_epoch"] = message.epoch
    match message.operation:
        case Operation.GOAL:
            return {**found, **_value(stream.codec, message.payload)}
        case Operation.FEEDBACK if not from_client:
            return {**found, **_value(stream.feedback_codec, message.payload)}
        case Operation.CANCEL | Operation.CANCEL_AGAIN if from_client:
            return {**found, "attempt": decode_cancel(message)}
        case Operation.REFUSED:
            refusal = decode_refusal(message.payload)
            assert refusal is not None
            found |= {"failure": message.payload[0], "text": refusal.text}
            again = message.payload[0] == _AGAIN_REFUSED
            return {**found, "attempt": refusal.attempt} if again else found
        case Operation.RESULT if message.payload == UNKNOWN_RESULT:
            return {**found, "status": "unknown"}
        case Operation.RESULT if message.payload == REMINDER:
            return {**found, "status": "reminder"}
        case Operation.RESULT:
            result = decode_result(message.payload)
            assert result is not None
            status, payload = result
            found["status"] = int(status)
            return {**found, **({} if payload is None else _value(stream.response_codec, payload))}
    return found


_FROM_CLIENT: Final = {
    Operation.GOAL: "GOAL",
    Operation.CLAIM: "CLAIM",
    Operation.CONFIRM: "CONFIRM",
    Operation.CANCEL: "CANCEL",
    Operation.CANCEL_AGAIN: "CANCEL AGAIN",
}
_FROM_SERVER: Final = {
    Operation.SUCCEEDED: "SUCCEEDED",
    Operation.ACCEPTED: "ACCEPTED",
    Operation.REFUSED: "REFUSED",
    Operation.CONFIRM: "CONFIRM",
    Operation.CANCEL: "CANCEL",
    Operation.FEEDBACK: "FEEDBACK",
    Operation.RESULT: "RESULT",
}


def _age(code: int) -> Fields:
    return {"age_code": code, "age_s": decode_age(code).seconds}


def _value(codec: PayloadCodec, payload: bytes) -> Fields:
    try:
        return {"payload": payload.hex(), "value": in_json(codec.decode(payload))}
    except PayloadError:
        return {"payload": payload.hex(), "refused": "payload"}


def in_json(value: object) -> object:
    """Return a value with its bytes as hexadecimal texts."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, dict):
        return {str(name): in_json(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [in_json(part) for part in value]
    if isinstance(value, float) and (value != value or abs(value) == float("inf")):
        return str(value)
    return value
