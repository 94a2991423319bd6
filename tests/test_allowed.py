"""A field's declaration is all there is: it refuses a value, and says what is allowed."""

import enum
from typing import Annotated, Literal

import msgspec
import pytest
from msgspec import Meta

from zacoustic.errors import ConfigError
from zacoustic.text.allowed import allowed, check_fields, find, mark, one_of, table_of, tables


class Wave(enum.Enum):
    SINE = "sine"
    CHIRP = "chirp"


class Fixed(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="fixed"):
    at: tuple[float, float] = (0.0, 0.0)


class Moving(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="moving"):
    speed: Annotated[float, Meta(gt=0, le=5.5, title="metres a second")]
    leader: Annotated[int, Meta(ge=1, le=254, extra={"hint": "name another"})] | None = None


class Record(msgspec.Struct, frozen=True, kw_only=True):
    count: Annotated[int, Meta(ge=1, le=65535)] = 1
    share: Annotated[float, Meta(gt=0, le=1, title="a share")] | None = None
    most: Annotated[int, Meta(le=7)] = 0
    rest_s: Annotated[float, Meta(ge=0, le=1e9, title="seconds")] = 0.0
    name: Annotated[str, Meta(pattern="^[a-z]+$", description="small letters")] = "a"
    word: Annotated[str, one_of(("red", "green"))] = "red"
    wave: Wave = Wave.SINE
    on: bool = True
    path: Annotated[
        tuple[Annotated[int, Meta(ge=1, le=254, title="an address")], ...],
        Meta(min_length=2, max_length=4, extra={"unique": True}),
    ] = (1, 2)
    place: Fixed | Moving | Literal["anywhere"] | None = None
    moving: tuple[Moving, ...] = ()


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("count", "a number, 1..65535"),
        ("share", "a share, above 0, at most 1"),
        ("most", "a number, at most 7"),
        ("rest_s", "seconds, 0 or more, at most 1e+09"),
        ("name", "small letters"),
        ("word", "red, green"),
        ("wave", "sine, chirp"),
        ("on", "true, false"),
        ("path", "a list of an address, 1..254, 2..4 of them"),
        ("place", '{ kind: "fixed" | "moving", … } or anywhere'),
        ("moving", "a list of { speed, … }"),
    ],
)
def test_words_follow_from_the_declaration(key: str, words: str) -> None:
    kind = find(table_of(Record), [key])
    assert kind is not None
    assert allowed(kind) == words


def test_declaration_is_found_by_the_tag_that_is_written() -> None:
    kind = table_of(Record)
    written = {"place": {"kind": "moving", "speed": 9}}
    speed = find(kind, ["place", "speed"], written)
    assert speed is not None
    assert allowed(speed) == "metres a second, above 0, at most 5.5"
    tag = find(kind, ["place", "kind"], written)
    assert tag is not None
    assert allowed(tag) == "fixed, moving"
    leader = find(kind, ["moving", 3, "leader"])
    assert leader is not None
    assert mark(leader, "hint") == "name another"
    assert find(kind, ["place", "nothing"], written) is None
    place = find(kind, ["place"])
    assert place is not None
    assert next(tables(place, written["place"])).cls is Moving


@pytest.mark.parametrize(
    ("record", "problem"),
    [
        (Record(count=0), "count is 0; allowed: a number, 1..65535"),
        (Record(share=float("nan")), "share is nan; allowed: a share, above 0, at most 1"),
        (Record(word="gren"), 'word is "gren"; allowed: red, green'),
        (Record(word="red\n"), 'word is "red\n"; allowed: red, green'),
        (Record(path=(1,)), "path is (1,); allowed: a list of an address, 1..254, 2..4 of them"),
        (Record(path=(1, 300)), "path[1] is 300; allowed: an address, 1..254"),
        (Record(path=(1, 2, 1)), "path[2] is 1 a second time; allowed: each once"),
        (Record(path=tuple(range(1, 99))), "path is (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12"),
    ],
)
def test_record_that_a_program_makes_is_checked(record: Record, problem: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (the text is compared)
        check_fields(record)
    assert str(caught.value).startswith(problem)
    assert len(str(caught.value)) < 150
    with pytest.raises(ConfigError) as named:
        check_fields(record, ConfigError)
    assert str(named.value) == str(caught.value).replace(" is ", ": ", 1)


def test_good_record_passes() -> None:
    check_fields(Record(count=65535, share=1, path=(1, 254), place=Fixed(), wave=Wave.CHIRP))
