"""The limits in the words of `ALLOWED`, as keywords of JSON Schema.

The words appear in every error and on every page. Deriving the schema from them ensures that it
allows the same values, and that each limit is written once.
"""

import re
from typing import Any, Final

_NUMBER: Final = r"(-?[0-9]+(?:\.[0-9]+)?(?:e[+-]?[0-9]+)?)"
_LIMITS: Final = (
    (re.compile(rf"{_NUMBER}\.\.{_NUMBER}"), ("minimum", "maximum")),
    (re.compile(rf"above {_NUMBER}"), ("exclusiveMinimum",)),
    (re.compile(rf"{_NUMBER} or more"), ("minimum",)),
    (re.compile(rf"at most {_NUMBER}"), ("maximum",)),
)
_WORD: Final = r"\"?[a-z_]+\"?"
_WORDS: Final = re.compile(rf"{_WORD}(, {_WORD})*")
_OF_TOPICS: Final = re.compile(r", for topics (\"[a-z_]+\")")
_ADDRESS: Final = {"minimum": 1, "maximum": 254}
_TIME: Final = "^([01][0-9]|2[0-3]):[0-5][0-9]$"
_RATIO: Final = "^ *[0-9]{1,15} */ *0*[1-9][0-9]{0,14} *$"


def limit(entry: dict[str, Any], allowed: str, *, is_topic: bool) -> None:
    """Add the limits in the words of a key to its schema.

    Args:
        entry: The schema so far: a type, or several in `anyOf`.
        allowed: The words.
        is_topic: The key is one of a topic.
    """
    for kind in entry.get("anyOf", (entry,)):
        match kind.get("type"):
            case "integer" | "number":
                kind |= _of_number(allowed)
            case "string":
                kind |= _of_text(allowed, is_topic=is_topic)
            case "array" if "address" in allowed:
                kind["items"] |= _ADDRESS
    if "a ratio" in allowed:
        entry["anyOf"].append({"type": "string", "pattern": _RATIO})


def _of_number(allowed: str) -> dict[str, Any]:
    if allowed.startswith("the address of"):
        return dict(_ADDRESS)
    found: dict[str, Any] = {}
    for pattern, keywords in _LIMITS:
        numbers = pattern.search(allowed)
        if numbers is not None:
            found |= {
                keyword: float(number) if "." in number else int(number)
                for keyword, number in zip(keywords, numbers.groups(), strict=True)
            }
    return found


def _of_text(allowed: str, *, is_topic: bool) -> dict[str, Any]:
    if allowed.startswith("a time of day"):
        return {"pattern": _TIME}
    words = _OF_TOPICS.sub(r", \1" if is_topic else "", allowed)
    if not _WORDS.fullmatch(words):
        return {}
    return {"enum": [word.strip('"') for word in words.split(", ")]}
