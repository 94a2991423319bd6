r"""Makes foreign text safe to show: one place for terminals, JSON and pages.

Names, values and error texts come from the channel, from programs on the network and from files.
They must not control what shows them: an escape sequence changes the terminal, a line end forges a
line, a right-to-left mark reverses the text beside it, and a page executes tags. All foreign text
goes through this module before it is shown; rich gets `Text` objects made of `one_line`, never
markup.

Invisible characters are written as in Python, `\x1b` or `\u202e`; in JSON as JSON writes them, so
that a reader gets back exactly the original.
"""

import json
import math
import re
from html import escape
from typing import Any, Final

_HIDDEN: Final = "***"
# A setting whose name is that of a secret, and the password before a host.
_SETTING: Final = re.compile(
    r"(?i)(?<![a-z])([\w.-]*(?:passw(?:or)?d|passphrase|secret|token|credential|api_?key|"
    r"private_?key|key_?base64|psk)[\w.-]*\s*=\s*)[^;&#\s,\"')]+"
)
_USER: Final = re.compile(r"(?<=[/\s\"'(])([^\s/:@\"'(]+):[^\s/@\"']+@")


def one_line(text: object) -> str:
    """Return a text as one line that cannot control a terminal."""
    written = str(text)
    return written if written.isprintable() else "".join(map(_visible, written))


def some_lines(text: object) -> str:
    """Return a text as lines that cannot control a terminal; line ends stay."""
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
    """Return a text for a page or an attribute: without tags and marks that reverse text."""
    return escape(one_line(text))


def without_secrets(text: object) -> str:
    """Return a text that names endpoints or locators, without the passwords in them."""
    return _SETTING.sub(rf"\1{_HIDDEN}", _USER.sub(rf"\1:{_HIDDEN}@", str(text)))


def _visible(letter: str) -> str:
    if letter.isprintable():
        return letter
    return letter.encode("unicode_escape").decode("ascii")


def _escaped(letter: str) -> str:
    """Return a character of a JSON text; unprintable ones occur inside strings only."""
    return letter if letter.isprintable() else json.dumps(letter)[1:-1].replace("\x7f", "\\u007f")


def _finite(value: Any) -> Any:  # noqa: ANN401 (whatever JSON holds)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return value
