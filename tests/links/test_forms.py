"""A form reads what it writes, for every kind of field, and neither reads nor writes anything else.

The grammar here belongs to no modem: a sentence with a checksum-like tail, padded columns, lists.
"""

import enum
import re
from typing import Annotated, Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.fieldvalues import an_example, beyond, limits, records
from zacoustic.link.fields import (
    Asked,
    Choice,
    Decimal,
    Field,
    Integer,
    Level,
    Maybe,
    Padded,
    Seconds,
    Several,
    Switch,
    Text,
    fields_of,
)
from zacoustic.link.forms import Form, Lines

Address = Annotated[int, Integer(0, 255)]


class Kind(enum.Enum):
    PING = "ping"
    DATA = "data+"


class Row(msgspec.Struct, frozen=True):
    delay: Annotated[int, Padded(Integer(0, 9999, digits=4), width=6)]
    label: Annotated[str, Text("[A-Z]{1,12}")]


class Sentence(msgspec.Struct, frozen=True, kw_only=True):
    to: Address
    kind: Kind
    level: Annotated[int, Level(-100, 100)]
    depth: Annotated[float, Decimal(2, 11_000.0)]
    at: Annotated[int, Seconds()]
    note: Annotated[str, Maybe(Text("[ -~]+"), ";", missing="")] = ""
    via: Annotated[int | None, Maybe(Integer(0, 7), "v", ":")] = None
    loud: Annotated[bool, Switch("!")] = False
    rates: Annotated[tuple[int, ...], Several(Integer(0, 99), 3)] = (1, 2, 3)
    rooms: Annotated[tuple[int, ...], Several(Integer(0, 99), separator=" ")] = ()
    asked: Annotated[int, Asked(Integer(0, 10**6), Integer(1, 9))] = 1
    older: Address | None = None
    untold: int = 0


SENTENCE = Form(
    Sentence, "${via}{loud}{to},{kind},{level},{depth},{at},{rates},{asked}{rooms}{note}"
)


class Table(msgspec.Struct, frozen=True):
    rows: Annotated[tuple[Row, ...], Lines(Form(Row, "{delay} {label}"), "\r\n")]


FORMS = (SENTENCE, Form(Row, "{delay} {label}"), Form(Table, "{rows}"))
EVERY_FORM = pytest.mark.parametrize("form", FORMS, ids=lambda form: form.record.__name__)


@EVERY_FORM
@given(content=st.data())
def test_form_reads_what_it_writes(form: Form[Any], content: st.DataObject) -> None:
    record = content.draw(records(form))
    assert form.read(form.write(record)) == record


@EVERY_FORM
def test_form_reads_and_writes_at_the_limits_and_writes_nothing_beyond(form: Form[Any]) -> None:
    example = an_example(form)
    for name, field in form.fields.items():
        for value in limits(field):
            record = msgspec.structs.replace(example, **{name: value})
            assert form.read(form.write(record)) == record
        for value in beyond(field):
            with pytest.raises(ValueError, match=f"{form.record.__name__}.{name}: "):
                form.write(msgspec.structs.replace(example, **{name: value}))


@given(text=st.text(st.sampled_from("$v1:!,ping-.;0 2\r\n"), max_size=60))
def test_form_reads_no_text_that_it_cannot_write(text: str) -> None:
    record = SENTENCE.read(text)
    assert record is None or SENTENCE.read(SENTENCE.write(record)) == record


def test_text_looks_as_the_template_says() -> None:
    sentence = Sentence(
        to=3, kind=Kind.DATA, level=-7, depth=12.346, at=1_500_000, note="a,b", via=2, loud=True,
        rooms=(5, 6),
    )  # fmt: skip
    text = "$v2:!3,data+,-7,12.35,1.500000,1,2,3,1 5 6;a,b"
    assert SENTENCE.write(sentence) == text
    assert SENTENCE.read(text) == msgspec.structs.replace(sentence, depth=12.35)
    assert FORMS[2].write(Table((Row(7, "A"), Row(12, "B")))) == "7      A\r\n12     B\r\n"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "$3,ping,1,1.0,1.0,1,2,3",  # a field is missing
        "$256,ping,1,1.0,1.0,1,2,3,1",
        "$3,pong,1,1.0,1.0,1,2,3,1",
        "$3,ping,1,nan,1.0,1,2,3,1",
        "$3,ping,1,1.0,-1.0,1,2,3,1",
        "$3,ping,1,1.0,1.0,1,2,100,1",
        "$3,ping,1,1.0,1.0,1,2,3,1 5 x",
        "$v8:3,ping,1,1.0,1.0,1,2,3,1",
        "$3,ping,1,1.0,1.0,1,2,3,1\n",
        "$٣,ping,1,1.0,1.0,1,2,3,1",
    ],
)
def test_other_text_is_no_record(text: str) -> None:
    assert SENTENCE.read(text) is None


def test_number_of_a_command_is_read_though_it_would_not_be_written() -> None:
    text = "$3,ping,1,1.0,1.0,1,2,3,77"
    record = SENTENCE.read(text)
    assert record is not None
    assert record.asked == 77
    with pytest.raises(ValueError, match=re.escape("asked: 77 is out of range; allowed: 1..9")):
        SENTENCE.write(record)


def test_surplus_is_read_and_forgotten() -> None:
    form = Form(Row, "{delay} {label}", surplus="(?:,.*)?")
    assert form.read("7 A,more") == Row(7, "A")
    assert form.read("7 A,") == Row(7, "A")
    assert form.read("7 Amore") is None


def test_field_that_is_not_in_the_text_comes_from_the_caller() -> None:
    record = SENTENCE.read("$3,ping,1,1.0,1.0,1,2,3,1", untold=5)
    assert record is not None
    assert record.untold == 5


def test_lines_have_any_end_and_all_of_them_must_be_lines() -> None:
    form = FORMS[2]
    expected = Table((Row(7, "A"), Row(12, "B")))
    for text in ("7 A\n12 B", "7 A\r\n\r\n12 B\r\n", "7     A\r12 B\n\n"):
        assert form.read(text) == expected
    for text in ("7 A\nB", "\n", " "):
        assert form.read(text) is None


def test_kinds_of_a_record_are_those_of_its_annotations() -> None:
    kinds = fields_of(Sentence)
    assert isinstance(kinds["kind"], Choice)  # an enumeration needs no annotation
    assert isinstance(kinds["older"], Integer)  # `Kind | None`: only some forms have the field
    assert "untold" not in kinds
    with pytest.raises(KeyError, match="untold"):
        Form(Sentence, "{untold}")


def test_field_of_any_text_has_one_line() -> None:
    assert Field().encode("a, b: c") == "a, b: c"
    with pytest.raises(ValueError, match="allowed"):
        Field().encode("a\nb")
