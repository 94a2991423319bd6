"""What a value of the section refers to, as the marks of `sections` say: nodes of the fleet, links.

One walk over the records finds each mark, so that no reader looks up an address or a name itself.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.config.problems import Place, shown
from zacoustic.text.allowed import find, mark, repeated, table_of

Known = Mapping[str, Mapping[object, str]]
"""What may be referred to: list of the section → value → how an error shows it."""

_HINTS: Final = {
    "nodes": "add it to nodes",
    "links": "give the links of the file a name each",
    "ways": "give the links of the file a name each",
}


def check_references(
    place: Place, value: object, kind: msgspec.inspect.Type | None, known: Known
) -> None:
    """Check a value and everything below it.

    Args:
        place: Its place.
        value: A value, list or record.
        kind: Its declaration.
        known: What may be referred to; a list of the section that is not there is not checked.

    Raises:
        ConfigError: A value refers to nothing, or is twice in a list that has each once.
    """
    if isinstance(value, msgspec.Struct):
        for field in table_of(type(value)).fields:
            here = place.at(field.encode_name)
            check_references(here, getattr(value, field.name), field.type, known)
        return
    if kind is None or value is None:
        return
    if isinstance(value, tuple):
        for key in mark(kind, "once") or ():
            _check_once(place, key)
        again = repeated(value, kind)
        if again is not None:
            place.at(again).refuse(f"{shown(value[again])} a second time", allowed="each once")
        for index, each in enumerate(value):
            check_references(place.at(index), each, find(kind, [index]), known)
        return
    of_list = mark(kind, "refers")
    names = known.get(of_list)
    if names is not None and value not in names:
        what = f"{value} is no node" if of_list == "nodes" else None
        allowed = ", ".join(names.values()) or "none, no link has a name"
        place.refuse(what, allowed=allowed, hint=_HINTS[of_list])


def _check_once(place: Place, key: str) -> None:
    """Check that no two tables of the list at `place` have the same value of a key."""
    first: dict[object, Place] = {}
    for item in place.items:
        here = item.at(key)
        other = first.setdefault(here.written, here)
        if other is not here:
            what = f"{shown(here.written)} a second time, as{other.path.replace('.', ' ', 1)}"
            here.refuse(what, allowed="one of its own")
