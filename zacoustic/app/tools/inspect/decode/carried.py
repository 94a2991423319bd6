"""Samples of the stream of carried samples, in words."""

from zacoustic.app.tools.inspect.decode.decoded import DecodedItem, decoded
from zacoustic.core.streams.carry import CARRY_STREAM_ID
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.wire.carry import (
    DIGEST_BYTES,
    Bundle,
    CarryRefusal,
    Envelope,
    Receipt,
    decode,
    is_direct,
)
from zacoustic.errors import UnknownStreamError


def explain_carried(
    message: bytes, head: str, table: StreamTable, sender: int, receiver: int
) -> DecodedItem:
    """Explain a carried sample, a receipt or a refusal; never raises.

    Args:
        message: The payload of the sample, without its number.
        head: What is known of the sample that has it.
        table: The streams.
        sender: Address of the node that transmitted it; 0: unknown.
        receiver: Address of the node that it is given to.
    """
    wildcards = {each.stream_id: len(each.keys.wildcards) for each in table.carried}
    said = decode(message, sender, receiver, wildcards)
    if said is None:
        return DecodedItem(
            kind="carried", stream_id=CARRY_STREAM_ID, value=message.hex(),
            text=f"{head}: {message.hex()} is no message of a carried topic of this configuration",
            fault="damaged, or of a topic that is not carried here",
        )  # fmt: skip
    stream = table.by_id(said.bundle.stream_id)
    key = _key(stream, said.bundle)
    named = f"{key} {_ends(said.bundle, is_direct(message), sender)}, number {said.number}"
    match said:
        case Envelope():
            head = f"{head}: {named}{_envelope(said, stream, is_direct(message))}"
            if said.deleted:
                return DecodedItem(
                    kind="carried", text=f"{head}, deleted", stream_id=CARRY_STREAM_ID, name=key
                )
            return decoded("carried", head, CARRY_STREAM_ID, key, stream.codec, said.payload)
        case Receipt(_, number):
            text = (
                f"{head}: RECEIPT, {key} {_ends(said.bundle)}: everything before {number} is there"
            )
        case CarryRefusal(_, _, is_final):
            why = "its subscriber defines the topic in another way" if is_final else "no room"
            text = f"{head}: REFUSAL of {named}: {why}"
    return DecodedItem(kind="carried", text=text, stream_id=CARRY_STREAM_ID, name=key)


def _ends(bundle: Bundle, is_direct: bool = False, sender: int = 0) -> str:
    if is_direct and not sender:
        return f"to node {bundle.destination}"
    return f"from node {bundle.origin} to node {bundle.destination}"


def _envelope(envelope: Envelope, stream: Stream, is_direct: bool) -> str:
    text = f" of count {envelope.bundle.lineage:04x}"
    if envelope.floor is not None:
        text += f", all before {envelope.floor} are done"
    if not is_direct:
        text += f", for {envelope.life_s / 60:g} min and {envelope.hops} more hops"
    if envelope.digest != stream.digest[:DIGEST_BYTES]:
        text += ", its publisher defines the topic in another way"
    if envelope.encoding is not None:
        text += f", {envelope.encoding}"
    return text


def _key(stream: Stream, bundle: Bundle) -> str:
    try:
        return stream.keys.key(bundle.origin, bundle.instance)
    except UnknownStreamError:
        return stream.name
