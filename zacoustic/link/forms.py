"""The forms of a modem's text messages: from one template both directions follow, read and write.

A form is a record and a template, literal characters with the record's fields between them::

    class SendEnd(msgspec.Struct, frozen=True, kw_only=True):
        destination: Address
        duration_us: Duration

    Form(SendEnd, "SENDEND,{destination},{duration_us}")

Limits, separators and special values are in the kinds of the fields (`fields`). So a driver and an
emulator of the same modem cannot disagree about them, and a table of forms is the grammar of a
modem. It knows neither a stream of bytes nor lines: a link divides its stream and asks the forms.
"""

import re
from string import Formatter
from typing import Any, Generic, TypeVar

from zacoustic.link.fields import Field, fields_of

R = TypeVar("R")


class Form(Generic[R]):
    """One kind of message: its record and its text.

    Args:
        record: Type of the record; called with fields by name.
        template: The text, with fields as `{name}`.
        surplus: Regular expression of what may follow and is not read.

    Raises:
        KeyError: The record has no kind for a field of the template.
    """

    def __init__(self, record: type[R], template: str, *, surplus: str = "") -> None:
        kinds = fields_of(record)
        pattern = ""
        self.record = record
        self.template = template
        self.fields: dict[str, Field] = {}
        for literal, name, _, _ in Formatter().parse(template):
            pattern += re.escape(literal)
            if name is not None:
                self.fields[name] = kinds[name]
                pattern += f"(?P<{name}>{kinds[name].pattern})"
        self._pattern = re.compile(pattern + surplus)

    def read(self, text: str, **others: object) -> R | None:
        """Return the record of a text; None: it is no such text, or has a value beyond a limit.

        Args:
            text: The whole text.
            others: Values of fields that are not in the text; they replace those that are.
        """
        match = self._pattern.fullmatch(text)
        if match is None:
            return None
        try:
            values = {name: field.decode(match[name]) for name, field in self.fields.items()}
            return self.record(**(values | others))
        except ValueError:
            return None

    def write(self, record: R) -> str:
        """Return the text of a record.

        Raises:
            ValueError: A value that its field does not allow.
        """
        texts = {}
        for name, field in self.fields.items():
            try:
                texts[name] = field.encode(getattr(record, name))
            except ValueError as error:
                raise ValueError(f"{type(record).__name__}.{name}: {error}") from None
        return self.template.format(**texts)

    def allows(self, record: R, name: str) -> bool:
        """Tell whether a field of a record may be written."""
        try:
            self.fields[name].encode(getattr(record, name))
        except ValueError:
            return False
        return True


class Lines(Field):
    """Lines of one form, as a tuple of records; at least one.

    Args:
        form: The form of each line.
        end: The end of each line, as written. Any line ends and empty lines are read.
    """

    pattern = r"(?s:.+)"

    def __init__(self, form: Form[Any], end: str = "\n") -> None:
        self.form = form
        self.end = end

    def decode(self, text: str) -> tuple[object, ...]:
        """Read all lines."""
        records = tuple(self.form.read(line) for line in text.splitlines() if line.strip())
        if not records or None in records:
            raise ValueError("no lines, or another line among them")
        return records

    def encode(self, value: object) -> str:
        """Write all lines."""
        if not isinstance(value, tuple) or not value:
            raise ValueError(f"{value!r} is not allowed; allowed: a tuple of records")
        return "".join(self.form.write(each) + self.end for each in value)
