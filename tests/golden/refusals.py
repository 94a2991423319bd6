"""Frames that a receiver must not read, or not all of: makes `refusals.json`, `ends.json`.

The second has those in which the question is where a refused record ends. Each is given to a real
engine, which has to refuse it for the stated reason and to read the rest.
After adding one: ``python -m tests.golden.refusals`` from the project's root.
"""

import itertools
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from tests.golden.fields import Fields, Reader, in_json
from tests.golden.sealed import KEY
from tests.golden.tables import TABLES, lines
from tests.virtual.sealed import SealedFleet
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.peers.sealing import Seal
from zacoustic.core.wire.envelope import stuff
from zacoustic.core.wire.seal import NO_TABLE
from zacoustic.seal.ccm import FleetCipher
from zacoustic.testing.virtual import Modem, VirtualNetwork

REFUSALS: Final = Path(__file__).parent / "refusals.json"
ENDS: Final = Path(__file__).parent / "ends.json"
MTU_BYTES: Final = 64
GOOD: Final = "0b6f6b"
"""A sample of stream 11: the bytes ``ok``."""
_NAV: Final = "0a1a02b4bfc0187b190a9b01"
_OTHER: Final = TABLES["other"]


class Refusal(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A frame, and what becomes of it."""

    name: str
    hex: str
    meaning: str
    table: str
    """The table of the receiver, by its name in `TABLES`."""
    source: int
    """Address of the sender, as the link or the frame says."""
    destination: int
    """Address to which it was sent, or 255."""
    receiver: int
    """Address of the node that refuses it."""
    introduced: bool
    """Whether receiver and node 1 or 2, each in epoch 1, have confirmed each other."""
    link: dict[str, bool] = {}
    """What the link brings, if the envelope is not empty."""
    before: list[str] = []
    """Frames of the same way that the receiver has read just before."""
    called: str = ""
    """Request with which the receiver has called stream 20 before; it waits for the answer."""
    key: dict[str, str | int] = {}
    """The key of the fleet, where frames are sealed; the port is 0."""
    reason: str
    """Why it is refused."""
    lost: str
    """The bytes of the records, or of the whole link frame, that are not read."""
    read: list[Fields]
    """What is read of it."""


class Case(msgspec.Struct, frozen=True, kw_only=True):
    """A frame in three parts: what is read, what is not, and what is read behind that."""

    name: str
    meaning: str
    reason: str
    first: str = ""
    lost: str = ""
    last: str = ""
    table: str = "base"
    source: int = 2
    receiver: int = 1
    broadcast: bool = False
    introduced: bool = True
    before: tuple[str, ...] = ()
    called: str = ""


class LinkCase(msgspec.Struct, frozen=True, kw_only=True):
    """A frame of a link that lacks something, none of whose records are read."""

    name: str
    meaning: str
    reason: str
    frame: str
    source: int = 2
    destination: int = 1
    framed: bool = True


def checked(frame: str) -> str:
    """Return addresses and records with their CRC-32."""
    octets = bytes.fromhex(frame)
    return (octets + zlib.crc32(octets).to_bytes(4, "big")).hex()


def stuffed(frame: str) -> str:
    """Return a frame of a byte stream."""
    return f"00{stuff(bytes.fromhex(frame)).hex()}00"


LINK_CASES: Final = (
    LinkCase(name="short", meaning="no room for addresses and CRC-32", reason="short",
             frame="010200ff"),
    LinkCase(name="damaged", meaning="the CRC-32 is another one", reason="check",
             frame=checked(f"0102{GOOD}")[:-2] + "00"),
    LinkCase(name="from_nobody", meaning="source 0", reason="address",
             frame=checked(f"0100{GOOD}"), source=0),
    LinkCase(name="from_all", meaning="source 255", reason="address",
             frame=checked(f"01ff{GOOD}"), source=255),
    LinkCase(name="to_nobody", meaning="destination 0", reason="address",
             frame=checked(f"0002{GOOD}"), destination=0),
    LinkCase(name="own", meaning="a frame with the address of the receiver as its source",
             reason="own", frame=checked(f"ff01{GOOD}"), source=1, destination=255),
    LinkCase(name="for_another", meaning="a frame for node 3", reason="not_for_us",
             frame=checked(f"0302{GOOD}"), destination=3),
    LinkCase(name="stuffing_too_long", meaning="COBS: a length that points behind the end",
             reason="stuffing", frame="0005010c00", framed=False),
    LinkCase(name="overlong", meaning="4097 bytes without a zero", reason="overlong",
             frame="00" + "11" * 4097 + "00", framed=False),
    LinkCase(name="damaged_stream", meaning="COBS is right, the CRC-32 is another one",
             reason="check", frame=stuffed(checked(f"0102{GOOD}")[:-2] + "00"), framed=False),
)  # fmt: skip
"""The receiver is node 1; the link has neither addresses nor check."""

_HELLO: Final = f"b0020001{TABLES['base'].digest.hex()}"
_HELLO_OTHER: Final = f"b0020001{_OTHER.digest.hex()}"
_SAMPLE: Final = "b800010000001e0064697665"

CASES: Final = (
    # Section 3: first bytes, controls, prefixes, LEN.
    Case(name="relay_without_route", meaning="RELAY where there is no route", reason="reserved",
         lost="bf013f0117", broadcast=True),
    Case(name="control_cut_off", meaning="HELLO of two bytes", reason="truncated",
         lost="b00200", broadcast=True),
    Case(name="len_behind_the_end", meaning="LEN of 5 before two bytes", reason="truncated",
         first=f"b203{GOOD}", lost="b2050b6f", broadcast=True),
    Case(name="len_before_control", meaning="LEN before a control that shows its end: that alone",
         reason="reserved", lost="b203b10001", last=GOOD, broadcast=True),
    Case(name="later_extension", meaning="an extension of a later version is skipped",
         reason="reserved", lost="b203c00102", last=GOOD, broadcast=True),
    Case(name="private_extension", meaning="an extension for private use is skipped",
         reason="reserved", lost="b203e00102", last=GOOD, broadcast=True),
    Case(name="hello_behind_record", meaning="HELLO behind a record, with all that follows",
         reason="reserved", first=_NAV, lost=f"{_HELLO}{GOOD}", broadcast=True),
    Case(name="tag_behind_record", meaning="TAG behind a record, with all that follows",
         reason="reserved", first=_NAV, lost=f"b10001{GOOD}", broadcast=True),
    Case(name="unknown_stream", meaning="the table has no stream 99: its end is unknown",
         reason="unknown_stream", first=_NAV, lost=f"630102{GOOD}", broadcast=True),
    Case(name="unknown_stream_behind_len", meaning="the same behind LEN: that record alone",
         reason="unknown_stream", lost="b203630102", last=GOOD, broadcast=True),
    Case(name="prefix_alone", meaning="ENCODING without a record", reason="truncated",
         lost="b4", broadcast=True),
    Case(name="prefix_before_control", meaning="DELETE before CONFIRM", reason="reserved",
         lost="b3b5020001", broadcast=True),
    Case(name="unlisted_encoding", meaning="encoding 30", reason="truncated",
         lost=f"b41e{GOOD}", broadcast=True),
    Case(name="empty_encoding", meaning="an encoding of no bytes", reason="truncated",
         lost=f"b4ff00{GOOD}", broadcast=True),
    Case(name="encoding_is_no_text", meaning="an encoding that is no UTF-8", reason="truncated",
         lost=f"b4ff01ff{GOOD}", broadcast=True),
    Case(name="ack_without_record", meaning="ACK alone, in a broadcast frame", reason="truncated",
         lost="b9", broadcast=True),
    # Section 9: FRAGMENT and FEEDBACK.
    Case(name="fragment_without_data", meaning="FRAGMENT 1 of no bytes", reason="truncated",
         lost="ba050001"),
    Case(name="fragment_neither", meaning="FRAGMENT FFFF with three bytes", reason="truncated",
         lost="ba05ffff010203"),
    Case(name="feedback_of_no_block", meaning="FEEDBACK lacks, count 0", reason="truncated",
         lost=f"bb050300{GOOD}"),
    Case(name="feedback_of_five_blocks", meaning="FEEDBACK lacks, count 5", reason="truncated",
         lost=f"bb0503050102030405{GOOD}"),
    Case(name="feedback_about_nothing", meaning="FEEDBACK about no object of the receiver",
         reason="object_answer", lost="bb450b4c60aa", last=GOOD),
    Case(name="fragment_of_a_stranger", meaning="node 9 is not in the list", reason="stranger",
         lost="ba0500010b6f6b", source=9),
    # Section 8: agreement.
    Case(name="other_version", meaning="HELLO of version 3: the rest is dropped", reason="version",
         lost=f"b0030001200b2be1{GOOD}", broadcast=True),
    Case(name="unknown_source", meaning="no HELLO of the source was heard", reason="unconfirmed",
         lost=GOOD, broadcast=True, introduced=False),
    Case(name="tag_of_unknown_source", meaning="TAG, and no HELLO was heard", reason="unconfirmed",
         first="b10001", lost=GOOD, broadcast=True, introduced=False),
    Case(name="not_settled", meaning="no TAG, right behind the HELLO of the epoch",
         reason="unconfirmed", lost=GOOD, broadcast=True, introduced=False, before=(_HELLO,)),
    Case(name="tag_of_another_epoch", meaning="TAG of epoch 4660", reason="unconfirmed",
         first="b11234", lost=GOOD, broadcast=True),
    Case(name="other_table", meaning="HELLO with another table, no row yet", reason="unconfirmed",
         first=_HELLO_OTHER, lost=GOOD, broadcast=True, introduced=False),
    Case(name="other_row", meaning="another table, and another row of the stream",
         reason="differs", first=f"{_HELLO_OTHER}b7000115{_OTHER.by_id(21).digest.hex()}",
         lost="156f6b", broadcast=True, introduced=False),
    Case(name="no_row", meaning="another table, which has no such stream", reason="differs",
         first=f"{_HELLO_OTHER}b700010b00000000", lost=GOOD, broadcast=True, introduced=False),
    Case(name="stranger", meaning="a request of node 9, which is not in the list",
         reason="stranger", first=_HELLO, lost="140001", source=9, receiver=2),
    Case(name="command_without_hello", meaning="a command without HELLO or TAG, not introduced",
         reason="unconfirmed", lost="af0200000b00f6f6f6f6f601", source=1, receiver=2,
         introduced=False),
    # Sections 4, 5, 11, 12: who may send what to whom.
    Case(name="no_publisher", meaning="node 1 is no publisher of stream 50",
         reason="not_publisher", lost="3201", table="on_demand", source=1, receiver=2),
    Case(name="no_subscriber", meaning="node 1 is no subscriber of stream 30",
         reason="not_subscriber", lost=_SAMPLE, table="reliable"),
    Case(name="no_client_operation", meaning="operation 6 from a client", reason="not_publisher",
         lost="28c0", table="action", source=1, receiver=2),
    Case(name="no_server", meaning="a command for node 3", reason="not_subscriber",
         first=_HELLO, lost="af0300000000f6f6f6f6f601", source=1, receiver=2),
    # Section 7: payloads. A malformed item hides the end of its record.
    Case(name="cbor_not_shortest", meaning="5 as 18 05: the rest of the frame is lost",
         reason="payload", lost=f"0a1a02b4bfc01805190a9b01{GOOD}", broadcast=True),
    Case(name="cbor_not_shortest_behind_len", meaning="the same behind LEN: that record alone",
         reason="payload", lost="b20c0a1a02b4bfc01805190a9b01", last=GOOD, broadcast=True),
    Case(name="cbor_of_another_kind", meaning="a text in place of a number", reason="payload",
         lost=f"0a616102b4bfc0187b190a9b01{GOOD}", broadcast=True),
    Case(name="cbor_out_of_bounds", meaning="heading 360: a whole item, that record alone",
         reason="payload", lost="0a1a02b4bfc0187b190e1001", last=GOOD, broadcast=True),
    Case(name="enum_out_of_bounds", meaning="mode 3 of three", reason="payload",
         lost="0a1a02b4bfc0187b190a9b03", last=GOOD, broadcast=True),
    Case(name="payload_cut_off", meaning="the enum is missing", reason="payload",
         lost="0a1a02b4bfc0187b190a9b", broadcast=True),
    Case(name="bytes_left_over", meaning="a byte behind the payload, within LEN",
         reason="payload", lost=f"b20d{_NAV}00", last=GOOD, broadcast=True),
    Case(name="packed_mark_not_needed", meaning="the mark 00 before a byte 8f", reason="payload",
         lost="33008f03", table="bytes", source=1, receiver=2, broadcast=True),
    # Sections 4, 5, 11, 12: contents.
    Case(name="age_missing", meaning="a stamped sample of no bytes", reason="payload",
         lost="0c", broadcast=True),
    Case(name="wildcard_out_of_bounds", meaning="value 3 of three", reason="payload",
         lost="0d0301", broadcast=True),
    Case(name="wildcard_missing", meaning="DELETE without its wildcard value", reason="payload",
         lost="b30d", broadcast=True),
    Case(name="call_byte_missing", meaning="a service without its byte", reason="payload",
         lost="14", source=1, receiver=2),
    Case(name="number_missing", meaning="a reliable sample without its number", reason="payload",
         lost="b800010000001e", table="reliable", source=1, receiver=2),
    Case(name="ack_too_long", meaning="an ACK of more than six bytes", reason="payload",
         lost="b91e80818181818101", table="reliable"),
    Case(name="ack_beyond_the_window", meaning="an ACK that holds 32 and more beyond",
         reason="payload", lost="b91e80ffffffff7f", table="reliable"),
    Case(name="goal_cut_off", meaning="a goal that ends within its type", reason="payload",
         lost="28001a02b4", table="action", source=1, receiver=2),
    Case(name="former_low_bits", meaning="FORMER whose operation has lower bits",
         reason="payload", lost="28e5123421", table="action", source=1, receiver=2),
    Case(name="former_of_former", meaning="FORMER in FORMER", reason="payload",
         lost="28e51234e0", table="action", source=1, receiver=2),
    Case(name="cancel_again_without_attempt", meaning="CANCEL AGAIN of no bytes",
         reason="payload", lost="28a5", table="action", source=1, receiver=2),
    # What comes again, or too late.
    Case(name="answer_to_no_call", meaning="a response, and nobody has called",
         reason="unexpected_answer", lost="14406f6b"),
    Case(name="answer_to_another_epoch", meaning="a named response for an epoch 2 modulo 64",
         reason="unexpected_answer", lost="1400426f6b", called="01"),
    Case(name="request_again", meaning="the same request a second time",
         reason="repeated_request", lost="140001", source=1, receiver=2, before=("140001",)),
    Case(name="sample_again", meaning="a reliable sample a second time",
         reason="repeated_sample", lost=_SAMPLE, table="reliable", source=1, receiver=2,
         before=(_SAMPLE,)),
    Case(name="lineage_before", meaning="a sample of one of the 16 lineages before",
         reason="repeated_sample", lost="b8fff90000001e0064697665", table="reliable", source=1,
         receiver=2, before=(_SAMPLE,)),
    Case(name="lineage_unknown", meaning="a sample without SYNC: the lineage is asked for",
         reason="out_of_sync", lost="1e0264697665", table="reliable", source=1, receiver=2),
    Case(name="ack_of_nothing", meaning="an ACK, and nothing was published",
         reason="unexpected_ack", lost="b91e03", table="reliable"),
    Case(name="ack_of_best_effort", meaning="an ACK of a topic that is not reliable",
         reason="unexpected_ack", lost="b90b03", last=GOOD),
    Case(name="answer_to_no_subscribe", meaning="the answer to no subscribe message",
         reason="unexpected_ack", lost="bce601040001", last=GOOD, table="on_demand"),
    Case(name="subscribe_to_all", meaning="SUBSCRIBE in a broadcast frame", reason="not_for_us",
         lost="bc4601040001", last=GOOD, table="on_demand", source=1, receiver=2, broadcast=True),
    Case(name="reference_unknown", meaning="a dense block whose reference is not held",
         reason="dense", first="b2020b72", lost="ea03b5b8", table="dense", source=1, receiver=2),
)  # fmt: skip


_ACTION: Final[dict[str, Any]] = {"table": "action", "source": 1, "receiver": 2}
_SERVICE: Final[dict[str, Any]] = {"source": 1, "receiver": 2}


def _left_over(name: str, meaning: str, record: str, **more: Any) -> Case:
    """Return a record that shows its end, with a byte behind it that LEN takes to it."""
    whole = f"b2{len(record) // 2 + 1:02x}{record}ff"
    meaning = f"{meaning}, and a byte left over within LEN: that record alone"
    return Case(name=f"{name}_left_over", meaning=meaning, reason="payload", lost=whole, last=GOOD,
                **more)  # fmt: skip


END_CASES: Final = (
    # Sections 3 to 5 and 12: bytes left over behind what shows its end.
    _left_over("delete", "DELETE", "b30b"),
    _left_over("delete_wildcard", "DELETE with a wildcard value", "b30d00"),
    _left_over("delete_reliable", "DELETE of a reliable topic", "b80001000000b31e00",
               table="reliable", **_SERVICE),
    Case(name="delete_behind_hello", meaning="DELETE without LEN behind HELLO: it ends with the "
         "frame", reason="payload", first=_HELLO, lost=f"b30d00{GOOD}", broadcast=True),
    _left_over("call_confirm", "confirm of a client", "14c0", **_SERVICE),
    _left_over("answer_confirm", "confirm of a server", "14c0"),
    _left_over("named_confirm", "named confirm of a server", "1400c1"),
    _left_over("claim", "CLAIM", "2820", **_ACTION),
    _left_over("goal_confirm", "CONFIRM of a client", "2860", **_ACTION),
    _left_over("cancel", "CANCEL", "2880", **_ACTION),
    _left_over("cancel_again", "CANCEL AGAIN", "28a001", **_ACTION),
    _left_over("former_cancel", "CANCEL of a former goal", "28e0123480", **_ACTION),
    _left_over("accepted", "ACCEPTED", "2820", table="action"),
    _left_over("reminder", "RESULT 81, the reminder", "28c081", table="action"),
    _left_over("no_result", "RESULT without a result", "28c085", table="action"),
    _left_over("ack", "ACK", "b91e03", table="reliable"),
    # Sections 3 and 4: prefixes stand before records of topics.
    *(
        Case(name=f"{name}_before_{kind}", meaning=f"{name.upper()} before a record of {what}: "
             "the rest of the frame", reason="reserved", first=_NAV, lost=f"{prefix}{record}{GOOD}",
             **more)
        for name, prefix in (
            ("delete", "b3"), ("encoding", "b404"), ("sync", "b80001000000"), ("ack", "b9"),
        )
        for kind, what, record, more in (
            ("call", "a service", "140001", _SERVICE), ("goal", "an action", "2880", _ACTION),
        )
    ),
    Case(name="prefix_before_call_behind_len", meaning="the same behind LEN: that record alone",
         reason="reserved", lost="b204b3140001", last=GOOD, **_SERVICE),
    Case(name="answer_to_all", meaning="a response to all: it may be to another client",
         reason="not_for_us", first=_NAV, lost="14406f6b", called="01", broadcast=True),
    Case(name="confirm_to_all", meaning="the confirm of a server to all: that record alone",
         reason="not_for_us", lost="14c0", last=GOOD, called="01", broadcast=True),
    Case(name="accepted_to_all", meaning="ACCEPTED to all: that record alone",
         reason="not_for_us", lost="2820", last=GOOD, table="action", broadcast=True),
    # Section 3: where it ends. What gives the end is as it may be: that record alone.
    Case(name="text_for_a_number", meaning="a text for the first number: a kind of section 7",
         reason="payload", lost="0a6161187b190a9b01", last=GOOD, broadcast=True),
    Case(name="bools_for_numbers", meaning="true for the first two numbers, an enum out of bounds",
         reason="payload", lost="0af5f50103", last=f"00{GOOD}", broadcast=True),
    Case(name="absent_for_a_number", meaning="F6 where nothing is optional", reason="payload",
         lost="0af6187b190a9b01", last=GOOD, broadcast=True),
    Case(name="wildcard_of_a_delete", meaning="DELETE of value 3 of three: that record alone",
         reason="payload", lost="b30d03", last=GOOD, broadcast=True),
    Case(name="wildcard_of_an_ack", meaning="ACK with value 3 of three: that record alone",
         reason="unexpected_ack", lost="b91f0302", last=GOOD, table="reliable"),
    Case(name="held_beyond_the_window", meaning="an ACK of five bytes, 32 beyond: that alone",
         reason="payload", lost="b91e80ffffffff7f", last=GOOD, table="reliable"),
    Case(name="ack_of_no_bits", meaning="an ACK whose last byte says nothing, and not 80 00",
         reason="payload", lost="b91e8500", last=GOOD, table="reliable"),
    Case(name="unlisted_status", meaning="RESULT 82 of no goal: nothing follows the status",
         reason="unexpected_answer", lost="28c082", last=GOOD, table="action"),
    # What gives the end is not: the rest of the frame.
    Case(name="ack_of_six_bytes", meaning="an ACK that goes on behind its fifth byte",
         reason="payload", lost=f"b91e80818181818101{GOOD}", table="reliable"),
    Case(name="array_in_a_number", meaning="an array for a number: no kind of section 7",
         reason="payload", lost=f"0a80187b190a9b01{GOOD}", broadcast=True),
    Case(name="former_with_low_bits", meaning="FORMER: CANCEL whose lower bits are not 0",
         reason="payload", lost=f"28e5123481{GOOD}", **_ACTION),
    Case(name="former_in_former", meaning="FORMER in FORMER", reason="payload",
         lost=f"28e51234e0{GOOD}", **_ACTION),
    Case(name="result_of_a_client", meaning="operation 6, RESULT 81, from a client",
         reason="not_publisher", lost=f"28c581{GOOD}", **_ACTION),
    Case(name="refused_of_a_client", meaning="operation 2 from a client",
         reason="not_publisher", lost=f"284501{GOOD}", **_ACTION),
    Case(name="response_of_a_client", meaning="kind 1 from a client", reason="not_publisher",
         lost=f"1440{GOOD}", **_SERVICE),
    Case(name="name_of_kind_0", meaning="a named answer of kind 0", reason="unexpected_answer",
         lost=f"140001{GOOD}"),
)  # fmt: skip


def refusals() -> list[Refusal]:
    """Return the frames of `refusals.json`, each verified with an engine."""
    sealed = [_sealed(*each) for each in _sealed_cases()]
    return [*map(_on_a_poor_link, LINK_CASES), *map(_on_a_good_link, CASES), *sealed]


def texts() -> dict[Path, str]:
    """Return the files."""
    made = {REFUSALS: refusals(), ENDS: [*map(_on_a_good_link, END_CASES)]}
    return {path: lines(msgspec.to_builtins(each)) + "\n" for path, each in made.items()}


def _on_a_poor_link(case: LinkCase) -> Refusal:
    modem = Modem(addressed=False, checked=False, framed=case.framed, mtu_bytes=MTU_BYTES)
    receiver = Receiver("base", 1, modem)
    receiver.take(case.frame, 0, BROADCAST)
    _verify(case.name, receiver, case.reason, [])
    return Refusal(
        name=case.name, hex=case.frame, meaning=case.meaning, table="base", source=case.source,
        destination=case.destination, receiver=1, introduced=True, reason=case.reason,
        link={"addressed": False, "checked": False, "framed": case.framed}, lost=case.frame,
        read=[],
    )  # fmt: skip


def _on_a_good_link(case: Case) -> Refusal:
    destination = BROADCAST if case.broadcast else case.receiver
    receiver = Receiver(case.table, case.receiver, Modem(), introduced=case.introduced)
    if case.called:
        receiver.call(bytes.fromhex(case.called))
    for frame in case.before:
        receiver.take(frame, case.source, destination)
        receiver.wait()
    receiver.forget()
    frame = case.first + case.lost + case.last
    receiver.take(frame, case.source, destination)
    table = TABLES["other" if _HELLO_OTHER in case.first else case.table]
    whole = bytes.fromhex(case.first + case.last)
    read = Reader(table).read(whole, case.source, destination)
    _verify(case.name, receiver, case.reason, read)
    return Refusal(
        name=case.name, hex=frame, meaning=case.meaning, table=case.table, source=case.source,
        destination=destination, receiver=case.receiver, introduced=case.introduced,
        before=list(case.before), called=case.called, reason=case.reason, lost=case.lost, read=read,
    )  # fmt: skip


def _sealed_cases() -> Iterator[tuple[str, str, str, list[bytes], bytes, str]]:
    """Yield name, meaning, reason, the frames before, the frame, and what of it is lost."""
    nav, digest = bytes.fromhex(_NAV), TABLES["base"].digest
    hello = bytes.fromhex(f"b0020007{digest.hex()}")

    def frames(life: int) -> Iterator[bytes]:
        seal = Seal(1, life, FleetCipher(KEY), JournalPort(), {}, lambda source: b"")
        yield seal.seal(hello + nav, BROADCAST, NO_TABLE, 0)
        while True:
            yield seal.seal(nav, BROADCAST, digest, 0)

    long, short = itertools.islice(frames(7), 2)
    damaged = long[:-1] + bytes((long[-1] ^ 1,))
    yield "sealed_damaged", "the last bit of the tag is another one", "forged", [], damaged, ""
    meaning = "a short head, and no long one was heard"
    yield "sealed_out_of_step", meaning, "out_of_step", [], short, ""
    yield "sealed_again", "the same frame a second time", "replayed", [long, short], short, ""
    former = next(frames(6))
    yield "sealed_former_life", "life 6 behind life 7", "former_life", [long], former, ""
    plain = bytes.fromhex(GOOD)
    yield "not_sealed", "a frame that is not sealed", "unsealed", [long], plain, ""
    seal = Seal(1, 7, FleetCipher(KEY), JournalPort(), {}, lambda source: b"")
    call = bytes.fromhex("140001")
    weak = seal.seal(call, 2, digest, 0)
    meaning = "a request in a frame with the tag of four bytes"
    yield "sealed_weak", meaning, "weak", [long], weak, call.hex()


def _sealed(
    name: str, meaning: str, reason: str, before: list[bytes], frame: bytes, lost: str
) -> Refusal:
    receiver = Receiver("base", 2, Modem(), introduced=False, build=SealedFleet(KEY))
    destination = 2 if lost else BROADCAST
    for each in before:
        receiver.take(each.hex(), 1, BROADCAST)
        receiver.wait()
    receiver.forget()
    receiver.take(frame.hex(), 1, destination)
    _verify(name, receiver, reason, [])
    return Refusal(
        name=name, hex=frame.hex(), meaning=meaning, table="base", source=1,
        destination=destination, receiver=2, introduced=False,
        before=[each.hex() for each in before], reason=reason, lost=lost or frame.hex(), read=[],
        key={"network": KEY.network, "generation": KEY.generation, "secret": KEY.secret.hex()},
    )  # fmt: skip


def _verify(name: str, receiver: "Receiver", reason: str, read: list[Fields]) -> None:
    expected = [each["value"] for each in read if each.get("record") == "sample"]
    if receiver.dropped != {reason: 1} or receiver.samples != expected:
        raise SystemExit(f"{name}: {receiver.dropped}, read {receiver.samples}")


class Receiver:
    """A node that takes frames as a link gives them.

    Args:
        table: The table of all nodes.
        address: Its address.
        modem: What its link lacks.
        introduced: Whether it and another node have confirmed each other.
        build: Makes the engines.
    """

    def __init__(
        self,
        table: str,
        address: int,
        modem: Modem,
        *,
        introduced: bool = True,
        build: MakeEngine = Engine,
    ) -> None:
        nodes = tuple(NodeSpec(address=each, position=(0.0, 0.0, 0.0)) for each in (1, 2))
        scenario = Scenario(nodes=nodes, profile="ideal", channel="none")
        self._network = VirtualNetwork(
            scenario, TABLES[table], modem=modem, digest=False, build=build
        )
        self._address = address
        if introduced:
            for each in (1, 2, 1, 2):
                self._network.publish(each, 11, b"")
                self._network.run()
        self.forget()

    def forget(self) -> None:
        """Begin to count anew."""
        self._network.events.clear()
        self._network.engine(self._address).stats.dropped.clear()

    def take(self, frame: str, source: int, destination: int) -> None:
        """Take a frame now."""

        def hear(engine: Engine, now: int) -> None:
            received = ReceivedFrame(
                frame_bytes=bytes.fromhex(frame),
                received_at=now,
                source=source,
                destination=destination,
            )
            engine.handle_frame(received, now)

        self._network.apply(self._address, hear)

    def call(self, request: bytes) -> None:
        """Call the service of the other node."""
        self._network.set_link(3 - self._address, up=False)
        self._network.apply(self._address, lambda engine, now: engine.call(20, request, now))

    def wait(self) -> None:
        """Let a copy of the last frame come in time, and not as its echo."""
        self._network.run(until_s=self._network.now / 1e9 + 1e-6)

    @property
    def dropped(self) -> dict[str, int]:
        """What it has refused, by reason."""
        return dict(self._network.engine(self._address).stats.dropped)

    @property
    def events(self) -> list[Event]:
        """Its events, in order."""
        return [event for address, event in self._network.events if address == self._address]

    @property
    def samples(self) -> list[Any]:
        """The values that it has delivered."""
        return [in_json(each.value) for each in self.events if isinstance(each, SampleReceived)]


if __name__ == "__main__":
    for path, text in texts().items():
        path.write_text(text, encoding="utf-8")
