"""Values of the kinds of fields: any, at the limits, and beyond them; for the forms of any link."""

import re
from typing import Any, Final

from hypothesis import strategies as st

from zacoustic.link.fields import (
    Asked,
    Choice,
    Decimal,
    Field,
    Integer,
    Maybe,
    Padded,
    Seconds,
    Several,
    Switch,
)
from zacoustic.link.forms import Form, Lines

TEXTS: Final = ("", "!", "A", "A B", "?AL", "A" * 12, "~" * 40, "a,b", "a: b", "~" * 41)
"""Of these, a field of text allows some, and refuses the others."""
PRINTABLE: Final = st.characters(min_codepoint=32, max_codepoint=126)
NO_TEXTS: Final = ("a\r\nb", "\n", "ä\n", 7, None)
"""Texts that no field of one line allows, and other values."""


def limits(field: Field) -> tuple[Any, ...]:
    """Give values of a field at its limits."""
    match field:
        case Integer():
            return field.low, field.high
        case Decimal():
            return -field.limit, 0.0, field.limit, 10.0**-field.decimals
        case Seconds():
            return 0, 1, 10**16 - 1
        case Choice():
            return tuple(field.kind)
        case Switch():
            return False, True
        case Maybe():
            return field.missing, *limits(field.field)
        case Asked():
            return limits(field.writes)
        case Padded():
            return limits(field.field)
        case Several():
            each = limits(field.field)
            counts = (0, 1, 3) if field.count is None else (field.count,)
            return tuple((value,) * count for value in each for count in counts)
        case Lines():
            return tuple((an_example(field.form),) * count for count in (1, 3))
        case _:
            return tuple(text for text in TEXTS if re.fullmatch(field.pattern, text))


def beyond(field: Field) -> tuple[Any, ...]:
    """Give values that a field does not allow."""
    match field:
        case Integer():
            return field.low - 1, field.high + 1, 1.5, "1", None
        case Decimal():
            return field.limit * 1.1, -field.limit * 1.1, float("nan"), float("inf"), "1.0", None
        case Seconds():
            return -1, 10**16, 1.5, None
        case Choice():
            return "ack", None
        case Switch():
            return ()
        case Maybe():
            return tuple(value for value in beyond(field.field) if value != field.missing)
        case Asked():
            return beyond(field.writes)
        case Padded():
            return beyond(field.field)
        case Several():
            one = limits(field.field)[0]
            wrong = tuple((value,) * (field.count or 1) for value in beyond(field.field))
            return (*wrong, None, *([] if field.count is None else [(one,) * (field.count + 1)]))
        case Lines():
            return None, ()
        case _:
            others = [text for text in TEXTS if not re.fullmatch(field.pattern, text)]
            return (*others, *NO_TEXTS)


def values(field: Field) -> st.SearchStrategy[Any]:
    """Give any value of a field."""
    match field:
        case Integer():
            inner: st.SearchStrategy[Any] = st.integers(field.low, field.high)
        case Decimal():
            scale = 10**field.decimals
            top = int(field.limit) * scale
            inner = st.integers(-top, top).map(lambda number: number / scale)
        case Seconds():
            inner = st.integers(0, 10**16 - 1)
        case Choice() | Switch():
            inner = st.nothing()
        case Maybe():
            inner = values(field.field)
        case Asked():
            inner = values(field.writes)
        case Padded():
            inner = values(field.field)
        case Several():
            one = values(field.field)
            inner = st.lists(one, max_size=9).map(tuple)
            if field.count is not None:
                inner = st.tuples(*[one] * field.count)
        case Lines():
            inner = st.lists(records(field.form), min_size=1, max_size=9).map(tuple)
        case _:
            inner = st.from_regex(field.pattern, fullmatch=True, alphabet=PRINTABLE)
    return st.one_of(inner, st.sampled_from(limits(field)))


def records(form: Form[Any], **others: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Give records of a form.

    Args:
        form: The form.
        others: Fields that are not in its text, or have other values there.
    """
    made = {name: values(field) for name, field in form.fields.items() if name not in others}
    return st.builds(form.record, **(made | others))


def an_example(form: Form[Any], **others: object) -> Any:
    """Give a record with the first limit in every field."""
    made = {name: limits(field)[0] for name, field in form.fields.items() if name not in others}
    return form.record(**(made | others))
