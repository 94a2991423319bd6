r"""Foreign text, made safe to show: one place for terminals, JSON and pages.

Names, values and error texts come off the channel, from programs on the network and out of files.
They are data, so they must not steer what shows them: a terminal obeys escape sequences, a line end
forges a line, a right-to-left mark turns what is beside it around, a page obeys tags. Everything
that shows text of others takes it through here; rich gets its `Text` objects made of `one_line`,
never its markup.

What cannot be seen is written as Python would write it, `\x1b` or `\u202e`; in JSON as JSON
does, so that a reader gets back exactly what was there.
"""

import json
import math
import re
from html import escape
from typing import Any, Final

_HIDDEN: Final = "***"
# A setting with the name of a secret, and the password in front of a host.
_SETTING: Final = re.compile(
    r"(?i)(?<![a-z])([\w.-]*(?:passw(?:or)?d|passphrase|secret|token|credential|api_?key|"
    r"private_?key|key_?base64|psk)[\w.-]*\s*=\s*)[^;&#\s,\"')]+"
)
_USER: Final = re.compile(r"(?<=[/\s\"'(])([^\s/:@\"'(]+):[^\s/@\"']+@")


def one_line(text: object) -> str:
    """Return a text as one line that a terminal can only show."""
    written = str(text)
    return written if written.isprintable() else "".join(map(_visible, written))


def some_lines(text: object) -> str:
    """Return a text of several lines that a terminal can only show; line ends stay."""
    return "\n".join(map(one_line, str(text).split("\n")))


def json_line(value: object) -> str:
    """Return a value as one line of JSON; NaN and the infinities, which JSON lacks, are null.

    Args:
        value: Of dicts, lists, texts, numbers, booleans and None.
    """
    try:
        text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(value), ensure_ascii=False, allow_nan=False)
    return text if text.isprintable() else "".join(map(_escaped, text))


def html_text(text: object) -> str:
    """Return a text for a page: no tag, no mark that turns others around; also in attributes."""
    return escape(one_line(text))


def without_secrets(text: object) -> str:
    """Return what names endpoints or locators without the passwords in them."""
    return _SETTING.sub(rf"\1{_HIDDEN}", _USER.sub(rf"\1:{_HIDDEN}@", str(text)))


def _visible(letter: str) -> str:
    if letter.isprintable():
        return letter
    return letter.encode("unicode_escape").decode("ascii")


def _escaped(letter: str) -> str:
    """Return a letter of a JSON text; those that are not printable stand inside of strings only."""
    return letter if letter.isprintable() else json.dumps(letter)[1:-1].replace("\x7f", "\\u007f")


def _finite(value: Any) -> Any:  # noqa: ANN401 (whatever JSON holds)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return value
