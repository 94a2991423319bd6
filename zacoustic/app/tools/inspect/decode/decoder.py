"""Frames in words, with or without the table of their sender.

Only the type of a stream tells where its record ends, so without a table the first record that LEN
does not delimit extends to the end of the frame. Dense blocks refer to earlier ones of their
source: a `FrameDecoder` remembers those that it has seen. Nothing here raises, whatever the bytes.
"""

import json
from collections.abc import Collection, Mapping
from typing import Any

from zacoustic.app.tools.inspect.decode.carried import explain_carried
from zacoustic.app.tools.inspect.decode.decoded import DecodedItem, decoded, printable
from zacoustic.app.tools.inspect.decode.desert import DesertWords
from zacoustic.app.tools.inspect.decode.overheard import Overheard
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.streams.carry import CARRY_STREAM_ID
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import AGE_FIELD, EVERY_NODE, Stream, StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.age import OLDER, UNKNOWN, age_words, decode_age
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.access import ANYBODY, NOBODY, ClockTime, Turn
from zacoustic.core.wire.agreement import (
    ABSENT_DIGEST,
    ASSURED,
    PROVISIONAL,
    WIRE_VERSION,
    Ask,
    Confirm,
    Hello,
    TableRow,
    Tag,
)
from zacoustic.core.wire.bond import bond_of
from zacoustic.core.wire.bond import decode as decode_bonded
from zacoustic.core.wire.calls import NAME_BYTES, NAMED, CallKind, decode_call_byte, decode_error
from zacoustic.core.wire.content import measure_content, server_of, split_age
from zacoustic.core.wire.controls import Extension, Item
from zacoustic.core.wire.flood import decode as decode_flooded
from zacoustic.core.wire.flood import is_flooded
from zacoustic.core.wire.frame import (
    DenseAck,
    DenseBlock,
    Prefixes,
    Record,
    Stray,
    parse_frame,
)
from zacoustic.core.wire.goals import (
    REMINDER,
    Operation,
    decode_cancel,
    decode_message,
    decode_refusal,
    decode_result,
)
from zacoustic.core.wire.numbers import NUMBER_BYTES, NUMBERS, WINDOW, decode_ack
from zacoustic.core.wire.objects import (
    NO_FRAGMENT,
    Complete,
    Fragment,
    Headless,
    Lacks,
    ListenHint,
    Refused,
)
from zacoustic.core.wire.relay import HopAcks, Number, Relayed, decode_probe, is_relayed
from zacoustic.core.wire.relay import decode as decode_relayed
from zacoustic.core.wire.subscriptions import PAGE_STREAMS, Subscribe, streams_of
from zacoustic.errors import UnknownStreamError

_WHY_STRAY = {
    "truncated": "the record is cut short",
    "reserved": "this version gives that first byte no meaning",
    "unknown_stream": "the configuration has no stream of that id, so where it ends is unknown",
}


_CALL_TEXTS = {
    ListenHint.ANSWER: "; its sender listens now, until it is answered",
    ListenHint.ANSWER_NEXT: "; its sender listens after the next, until it is answered",
    ListenHint.WINDOW: "; a listen window begins now",
    ListenHint.NONE: "",
}


def decode_frame(
    records: bytes, table: StreamTable | None = None, *, source: int = 0
) -> list[DecodedItem]:
    """Explain a frame in words; never raises.

    Args:
        records: The frame without the envelope of link or core.
        table: The streams; None: values stay in hexadecimal.
        source: Address of the sender, if known: fills in `{node}`.
    """
    return FrameDecoder(table).decode(records, source=source)


class FrameDecoder:
    """Explains frames in words, one after the other.

    Args:
        table: The streams; None: values stay in hexadecimal.
        wire: Wire profile; None: the table's, native without one.
        bonds: Numbers of bonds of links; others are those of routes.
    """

    def __init__(
        self,
        table: StreamTable | None = None,
        *,
        wire: WireProfile | None = None,
        bonds: Collection[int] = (),
    ) -> None:
        self._table = table
        self._bonds = frozenset(bonds)
        wire = wire or (table.wire if table is not None else WireProfile.NATIVE)
        self._desert = DesertWords(table) if wire is WireProfile.RMW_DESERT else None
        self._overheard = Overheard(table) if table is not None else None

    def decode(
        self, records: bytes, *, source: int = 0, unicast: bool = False
    ) -> list[DecodedItem]:
        """Explain a frame in words; never raises.

        Args:
            records: The frame without the envelope of link or core.
            source: Address of the sender, if known.
            unicast: The frame is known to be for one node.
        """
        if self._desert is not None:
            return self._desert.explain(records, source)
        if is_relayed(records):
            return self._relayed(records)
        reader = _Reader(self._table, source)
        items: list[DecodedItem] = []
        for item in parse_frame(records, reader.measure, CONTROLS, unicast=unicast):
            if isinstance(item, Hello | Tag) and self._overheard is not None:
                self._overheard.introduced(source, item.epoch)
            if isinstance(item, DenseBlock):
                items += reader.explain_dense(item.block, self._overheard)
            else:
                items.append(reader.explain(item))
        return items

    def _relayed(self, records: bytes) -> list[DecodedItem]:
        """Explain a frame of a route or bond, or a flooded one, with the one inside."""
        if is_flooded(records):
            return self._flooded(records)
        if bond_of(records) in self._bonds:
            return self._bonded(records)
        if (probe := decode_probe(records)) is not None:
            text = f"RELAY probe {probe.number} of run {probe.run}"
            return [DecodedItem(kind="relay", text=text)]
        match decode_relayed(records):
            case Relayed(number, content, more, is_urgent, age):
                text = f"RELAY {'urgent, ' if is_urgent else ''}{_number_text(number)}"
                text += f", {_age_of(age)}"
                text += "; another one follows" if more else ""
                inside = self.decode(content, unicast=True)
                return [DecodedItem(kind="relay", text=text), *inside]
            case HopAcks(numbers, more):
                several = ", ".join(map(_number_text, numbers))
                text = f"RELAY hop acknowledgement of {several}"
                text += "; a relayed frame follows" if more else ""
                return [DecodedItem(kind="relay", text=text)]
            case _:
                why = "a relayed frame that is cut short, or of a later version"
                text = f"STRAY {len(records)} bytes: {why}"
                return [DecodedItem(kind="stray", text=text, fault="relay_format")]

    def _flooded(self, records: bytes) -> list[DecodedItem]:
        flooded = decode_flooded(records)
        if flooded is None:
            text = f"STRAY {len(records)} bytes: a flooded frame that is cut short"
            return [DecodedItem(kind="stray", text=text, fault="flood_format")]
        to = "all" if flooded.destination == BROADCAST else f"node {flooded.destination}"
        text = f"RELAY {flooded.seq}, flooded by node {flooded.origin} for {to}"
        text += f", {_age_of(flooded.age)}; {flooded.left} further nodes may pass it on"
        is_for_one = flooded.destination != BROADCAST
        inside = self.decode(flooded.content, source=flooded.origin, unicast=is_for_one)
        return [DecodedItem(kind="relay", text=text), *inside]

    def _bonded(self, records: bytes) -> list[DecodedItem]:
        bonded = decode_bonded(records)
        if bonded is None:
            text = f"STRAY {len(records)} bytes: a frame of a bond that is cut short"
            return [DecodedItem(kind="stray", text=text, fault="relay_format")]
        text = f"RELAY {bonded.seq} of bond {bonded.number}"
        text += f", {_age_of(bonded.age)}" if bonded.content else ""
        text += "; its receivers answer" if bonded.wants_answer else ""
        inside = self.decode(bonded.content) if bonded.content else []
        return [DecodedItem(kind="relay", text=text), *inside]


def _number_text(number: Number) -> str:
    where = "first" if number.is_back else "last"
    return f"{number.seq} of route {number.route} to its {where} node"


class _Reader:
    """Reads the items of one frame."""

    def __init__(self, table: StreamTable | None, source: int) -> None:
        self._table = table
        self._source = source

    def measure(self, stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes) -> int | None:
        """Find the end of a record, like the engine."""
        if self._table is None:
            return None
        stream = self._table.get(stream_id)
        if stream is None:
            raise KeyError(stream_id)
        return measure_content(stream, buffer, offset, prefixes, self._source)

    def explain_dense(self, block: bytes, overheard: Overheard | None) -> list[DecodedItem]:
        head = f"dense string of {len(block)} bytes: {block.hex()}"
        fault = ""
        samples: tuple[tuple[int, dict[str, Any]], ...] = ()
        if overheard is not None:
            try:
                samples = overheard.read(self._source, block)
            except PayloadError as error:
                fault = str(error)
                head += f" is not decoded: {fault}"
        first = DecodedItem(kind="dense", text=head, value=block.hex(), fault=fault)
        return [first, *(self._dense_sample(*each) for each in samples)]

    def _dense_sample(self, stream_id: int, value: Mapping[str, Any]) -> DecodedItem:
        assert self._table is not None
        stream = self._table.by_id(stream_id)
        key = _key(stream, self._source, ())
        head = f"stream {stream_id} {key}"
        said = {name: part for name, part in value.items() if name != AGE_FIELD}
        shown = printable(stream.dense_sample(said))
        if AGE_FIELD in value:
            head += f", {_age_of(value[AGE_FIELD])}"
        text = f"{head}: {json.dumps(shown, ensure_ascii=False)}"
        return DecodedItem(kind="sample", text=text, stream_id=stream_id, name=key, value=shown)

    def explain(self, item: Item) -> DecodedItem:
        match item:
            case Record():
                return self._record(item)
            case Hello():
                return self._hello(item)
            case Tag(epoch):
                text = f"TAG epoch {epoch}: I do not know whether you know my table"
                return DecodedItem(kind="tag", text=text)
            case Confirm(address, epoch):
                named = {ASSURED: "you, who have confirmed me", PROVISIONAL: "you, for this frame"}
                node = named.get(address, f"node {address}")
                text = f"CONFIRM {node}, epoch {epoch}: our tables are the same"
                return DecodedItem(kind="confirm", text=text)
            case Ask(address, stream_id):
                wanted = f"the digest of stream {stream_id}" if stream_id else "its HELLO"
                text = f"ASK node {address} for {wanted}"
                return DecodedItem(kind="ask", text=text, stream_id=stream_id)
            case TableRow(epoch, stream_id, digest):
                held = "is not in my table" if digest == ABSENT_DIGEST else f"is {digest.hex()}"
                text = f"TABLE epoch {epoch}: stream {stream_id} {held}"
                return DecodedItem(kind="table", text=text, stream_id=stream_id)
            case Turn():
                return DecodedItem(kind="turn", text=_turn_text(item))
            case ClockTime(time_ns, error_ns):
                off = "unknown" if error_ns is None else f"{error_ns / NS_PER_S:g} s"
                text = f"CLOCK {time_ns / NS_PER_S:.4f} s since 1970, error {off}"
                return DecodedItem(kind="clock", text=text)
            case Fragment(transfer, call, index, fragment_bytes):
                listens = _CALL_TEXTS[call]
                size = len(fragment_bytes)
                text = f"FRAGMENT {index} of object {transfer}, {size} bytes{listens}"
                if index == NO_FRAGMENT:
                    text = f"FRAGMENT object {transfer} is withdrawn"
                    if fragment_bytes:
                        text = f"FRAGMENT nothing before object {transfer} will come"
                return DecodedItem(kind="fragment", text=text)
            case Lacks(transfer, block, lacking):
                several = ", ".join(str(each) for each in lacking)
                text = f"FEEDBACK object {transfer} lacks {several} from block {block} on"
                if item.is_nothing:
                    text = f"FEEDBACK object {transfer} waits for samples before it"
                return DecodedItem(kind="feedback", text=text)
            case Complete(transfer):
                return DecodedItem(kind="feedback", text=f"FEEDBACK object {transfer} is complete")
            case Refused(transfer, reason):
                text = f"FEEDBACK object {transfer} is refused, reason {reason}"
                return DecodedItem(kind="feedback", text=text)
            case Headless(transfer, held):
                text = f"FEEDBACK object {transfer}: {held} fragments, no manifest"
                return DecodedItem(kind="feedback", text=text)
            case Subscribe():
                return DecodedItem(kind="subscribe", text=_subscribe_text(item))
            case DenseAck():
                return DecodedItem(kind="dense_ack", text=_dense_ack_text(item))
            case Stray(reason, size_bytes):
                why = _WHY_STRAY.get(reason, reason)
                text = f"STRAY {size_bytes} bytes: {why}"
                return DecodedItem(kind="stray", text=text, fault=reason)
            case Extension(code, body):
                text = f"EXTENSION {code:02X} of a transport not known here: {body.hex()}"
                return DecodedItem(kind="extension", text=text, value=body.hex())
            case _:
                raise AssertionError(f"no words for {item}")

    def _hello(self, hello: Hello) -> DecodedItem:
        text = f"HELLO version {hello.version}, epoch {hello.epoch}, table {hello.digest.hex()}"
        fault = ""
        if hello.version != WIRE_VERSION:
            fault = f"another wire version than {WIRE_VERSION}"
        elif self._table is not None and hello.digest != self._table.digest:
            fault = f"another table than {self._table.digest.hex()}"
        return DecodedItem(kind="hello", text=f"{text}: {fault}" if fault else text, fault=fault)

    def _record(self, record: Record) -> DecodedItem:
        stream = self._table.get(record.stream_id) if self._table is not None else None
        if stream is None:
            return _unread(record)
        if record.prefixes != Prefixes() and not isinstance(stream.spec, TopicSpec):
            return _unread(record)
        if isinstance(stream.spec, ServiceSpec):
            return _call(stream, stream.spec, record, self._source)
        if isinstance(stream.spec, ActionSpec):
            return _goal(stream, stream.spec, record, self._source)
        return self._sample(stream, record)

    def _sample(self, stream: Stream, record: Record) -> DecodedItem:
        prefixes = record.prefixes
        wild = len(stream.keys.wildcards)
        instance, payload = tuple(record.content[:wild]), record.content[wild:]
        key = _key(stream, self._source, instance)
        head = f"stream {stream.stream_id} {key}"
        if prefixes.acknowledged is not None:
            return _ack(stream, key, head, record, payload)
        if stream.qos.reliability is Reliability.RELIABLE:
            head += f", number {payload[0] % NUMBERS}" if payload else ", without its number"
            payload = payload[NUMBER_BYTES:]
        if prefixes.sync is not None:
            head += f" (count of epoch {prefixes.sync.lineage} from {prefixes.sync.floor})"
        if stream.stream_id == CARRY_STREAM_ID and self._table is not None:
            to = instance[0] if instance else 0
            return explain_carried(payload, head, self._table, self._source, to)
        if prefixes.delete and payload:
            return _unread(record)
        if prefixes.delete:
            return DecodedItem(
                kind="delete", text=f"{head} deleted", stream_id=stream.stream_id, name=key
            )
        if stream.qos.stamp is Stamp.AGE:
            head += f", {_age_of(payload[0])}" if payload else ", without its age"
            payload = payload[1:]
        if prefixes.encoding is not None:
            head += f", {prefixes.encoding}"
        return decoded("sample", head, stream.stream_id, key, stream.codec, payload)


def _key(stream: Stream, source: int, instance: Instance) -> str:
    try:
        return stream.keys.key(source, instance)
    except UnknownStreamError:
        return stream.name


def _turn_text(turn: Turn) -> str:
    span_s = turn.span_ns / NS_PER_S
    if turn.node == NOBODY:
        return "TURN is given back"
    if turn.node == ANYBODY:
        return f"TURN for anybody: I pause {span_s:g} s after the beginning of this frame"
    return f"TURN of node {turn.node} for {span_s:g} s"


def _subscribe_text(said: Subscribe) -> str:
    first = said.page * PAGE_STREAMS
    of_page = f"{first}..{first + PAGE_STREAMS - 1}, version {said.version}"
    wanted = ", ".join(str(each) for each in streams_of(said.page, said.streams)) or "none"
    verb = "noted, you want" if said.is_answer else "I want"
    heard = "" if said.heard is None else f"; epoch {said.heard:04x} of the destination"
    passing = "; for a while" if said.is_answer and not said.is_kept else ""
    return f"SUBSCRIBE of the streams {of_page}: {verb} {wanted}{heard}{passing}"


def _dense_ack_text(ack: DenseAck) -> str:
    whose = f"node {ack.address}" if ack.address else "its destination"
    return f"ACK for {whose}: its dense string {ack.mark:04x} is held here"


def _ack(stream: Stream, key: str, head: str, record: Record, content: bytes) -> DecodedItem:
    ack, prefixes = decode_ack(content), record.prefixes
    if ack is None:
        return _unread(record)
    whose = f"node {prefixes.acknowledged}" if prefixes.acknowledged else "its destination"
    text = f"{head}: ACK for {whose}: "
    if not ack.knows:
        text += "I do not know your count"
    elif prefixes.sync is not None:
        text += f"count of epoch {prefixes.sync.lineage}, I expect {prefixes.sync.floor}"
    else:
        text += f"I expect number {ack.expected}"
    held = [str((ack.expected + 1 + bit) % NUMBERS) for bit in range(WINDOW) if ack.held >> bit & 1]
    text += f", and hold {', '.join(held)}" if held else ""
    return DecodedItem(kind="ack", text=text, stream_id=stream.stream_id, name=key)


def _call(stream: Stream, spec: ServiceSpec, record: Record, source: int) -> DecodedItem:
    server, start = server_of(spec, record.content, 0)
    content = record.content[start:]
    if not content:
        return _unread(record)
    kind, number = decode_call_byte(content[0])
    payload = content[1:]
    life = f" of node {server}" if spec.server == EVERY_NODE else ""
    if server == source and kind is NAMED:
        if not payload:
            return _unread(record)
        kind, life = CallKind(payload[0] >> 6), f"{life} of a life {payload[0] & 0x3F} mod 64"
        payload = payload[NAME_BYTES:]
    head = f"stream {stream.stream_id} {stream.name}, {kind.name.lower()} of call {number}{life}"
    if kind is CallKind.CONFIRM and payload:
        return _unread(record)
    if kind is CallKind.CONFIRM:
        return DecodedItem(
            kind="call_confirm", text=head, stream_id=stream.stream_id, name=stream.name
        )
    if kind is CallKind.ERROR:
        failure, text = decode_error(payload) or (None, payload.hex())
        said = f"{failure.name.lower() if failure else 'unreadable'}: {text}"
        return DecodedItem(
            kind="error", text=f"{head}: {said}", stream_id=stream.stream_id, name=stream.name,
            value=said,
        )  # fmt: skip
    code, payload = split_age(stream, payload)
    head += "" if code is None else f", {_age_of(code)}"
    codec = stream.codec if kind is CallKind.REQUEST else stream.response_codec
    return decoded(kind.name.lower(), head, stream.stream_id, stream.name, codec, payload)


def _goal(stream: Stream, spec: ActionSpec, record: Record, source: int) -> DecodedItem:
    message = decode_message(record.content, from_client=source != spec.server)
    if message is None:
        return _unread(record)
    operation, payload = message.operation, message.payload
    word = "" if operation is Operation.GOAL else f"_{operation.name.lower()}"
    from_client = source not in (0, spec.server)
    if operation is Operation.ACCEPTED and from_client:
        word = "_claim"
    if operation is Operation.CANCEL_AGAIN and from_client:
        operation, word = Operation.CANCEL, "_cancel"
    kind = f"goal{word}"
    of_epoch = "" if message.epoch is None else f" of epoch {message.epoch}"
    said = word.removeprefix("_") or "sent"
    if payload and operation is Operation.CANCEL:
        said += f" again, attempt {decode_cancel(message)}"
    text = f"stream {stream.stream_id} {stream.name}, goal {message.number}{of_epoch}: {said}"
    found = (stream.stream_id, stream.name)
    match operation:
        case Operation.GOAL:
            return decoded(kind, text, *found, stream.codec, payload)
        case Operation.FEEDBACK:
            return decoded(kind, text, *found, stream.feedback_codec, payload)
        case Operation.RESULT if payload == REMINDER:
            text += " was said: has it arrived?"
        case Operation.RESULT:
            status, result = decode_result(payload) or (None, payload or None)
            text += f" {'unreadable' if status is None else status.name.lower()}"
            if result is not None:
                return decoded(kind, text, *found, stream.response_codec, result)
        case Operation.REFUSED:
            refusal = decode_refusal(payload)
            if refusal is None:
                text += f" unreadable: {payload.hex()}"
            else:
                text += f" {refusal.failure.name.lower()}"
                text += f", attempt {refusal.attempt}" if refusal.attempt else ""
                text += f": {refusal.text}"
        case _:
            pass
    return DecodedItem(kind=kind, text=text, stream_id=stream.stream_id, name=stream.name)


def _unread(record: Record) -> DecodedItem:
    """A record of an unknown type."""
    before = record.prefixes
    prefixes = " deleted" if before.delete else ""
    prefixes += f", {before.encoding}" if before.encoding is not None else ""
    prefixes += " acknowledged" if before.acknowledged is not None else ""
    content = record.content.hex() or "nothing"
    return DecodedItem(
        kind="record",
        text=f"stream {record.stream_id}{prefixes}: {content}",
        stream_id=record.stream_id,
        value=record.content.hex(),
    )


def _age_of(code: int) -> str:
    """Return the age that a code stands for, as its frame began."""
    seconds = decode_age(code).seconds
    return age_words(seconds) if code in (OLDER, UNKNOWN) else f"{seconds:g} s old"
