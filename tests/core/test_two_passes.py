"""A frame is read in two passes: first what it says of its sender, then the rest in its light."""

import re
from pathlib import Path

import pytest

from tests.core.rig import End, Rig
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire import access, agreement, objects, subscriptions
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello, TableRow, Tag
from zacoustic.core.wire.controls import Controls, Extension, Form
from zacoustic.core.wire.frame import Control

PAGE = Path(__file__).parents[2] / "docs" / "wire.md"
OTHER_EPOCH = 7
OTHER_DIGEST = b"else"


def fleet() -> StreamTable:
    topics = [TopicSpec(stream_id=1, name="one"), TopicSpec(stream_id=2, name="two")]
    return StreamTable(topics, nodes={1: "shore", 2: "auv"})


def delimited(record: bytes) -> bytes:
    return bytes((Control.LEN, len(record))) + record


def received(end: End) -> list[object]:
    return [sample.value for sample in end.got(SampleReceived)]


@pytest.mark.parametrize("is_behind", [False, True])
def test_what_a_frame_says_of_its_sender_counts_for_all_of_its_records(is_behind: bool) -> None:
    node = Rig({1: fleet(), 2: fleet()})[2]
    hello = Hello(WIRE_VERSION, OTHER_EPOCH, OTHER_DIGEST).encode()
    row = TableRow(OTHER_EPOCH, 1, fleet().by_id(1).digest).encode()
    record = delimited(b"\x01depth")
    said = record + row if is_behind else row + record
    node.hear(hello + said, 0, source=1)
    assert received(node) == [b"depth"]
    assert node.engine.stats.dropped == {}


def test_a_difference_that_a_frame_tells_counts_for_its_records() -> None:
    node = Rig({1: fleet(), 2: fleet()})[2]
    hello = Hello(WIRE_VERSION, OTHER_EPOCH, OTHER_DIGEST).encode()
    row = TableRow(OTHER_EPOCH, 1, b"diff").encode()
    node.hear(hello + delimited(b"\x01depth") + row, 0, source=1)
    assert received(node) == []
    assert node.engine.stats.dropped == {"differs": 1}


@pytest.mark.parametrize(
    "late", [Tag(OTHER_EPOCH).encode(), Hello(WIRE_VERSION, OTHER_EPOCH, OTHER_DIGEST).encode()]
)
@pytest.mark.parametrize("record", [b"\x01depth", b"\x02depth"])
def test_hello_and_tag_behind_a_record_say_nothing(late: bytes, record: bytes) -> None:
    node = Rig({1: fleet(), 2: fleet()})[2]
    first = Hello(WIRE_VERSION, 5, fleet().digest).encode()
    node.hear(first + delimited(record) + late + b"\x01more", 0, source=1)
    assert received(node) == [b"depth"]
    assert node.engine.stats.dropped == {"reserved": 1}


@pytest.mark.parametrize("body", [b"", b"\x01more", bytes(254)])
def test_an_extension_that_nobody_knows_is_skipped(body: bytes) -> None:
    node = Rig({1: fleet(), 2: fleet()})[2]
    first = Hello(WIRE_VERSION, 5, fleet().digest).encode()
    node.hear(first + Extension(0xE7, body).encode() + b"\x01depth", 0, source=1)
    assert received(node) == [b"depth"]
    assert node.engine.stats.dropped == {"reserved": 1}


def test_an_extension_out_of_bounds_is_not_written() -> None:
    for wrong in (Extension(0xDF, b""), Extension(0xE0, bytes(255))):
        with pytest.raises(ValueError, match=r"allowed: (E0\.\.FF|0\.\.254)"):
            wrong.encode()


def test_no_code_has_two_owners() -> None:
    with pytest.raises(ValueError, match="B0"):
        Controls(*agreement.FORMS, Form(0xB0, "AGAIN", lambda buffer, offset: None))


def test_the_page_prints_the_controls_and_their_owners() -> None:
    page = PAGE.read_text(encoding="utf-8")
    printed = {int(code, 16): name for code, name in re.findall(r"\| `(B.)` \| (\w+) \|", page)}
    known = {form.code: form.name for form in CONTROLS.values()}
    records = {int(control): control.name for control in Control}
    assert printed == known | records | {0xBF: "RELAY"}
    rows = re.findall(r"^\| `B.` \| (\w+) \|.*\| ([0-9]+)[^|]*\|$", page, re.MULTILINE)
    owners = {name: int(section) for name, section in rows}
    forms = {
        8: agreement.FORMS, 9: objects.FORMS, 10: access.FORMS, 13: subscriptions.FORMS,
    }  # fmt: skip
    owned = {form.name: section for section, each in forms.items() for form in each}
    owned |= {"LEN": 3, "DELETE": 4, "ENCODING": 4, "SYNC": 11, "ACK": 11, "RELAY": 16}
    assert owners == owned
