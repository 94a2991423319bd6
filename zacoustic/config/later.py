"""Words of the configuration's format that this version does not have yet.

They are refused by name, never ignored: who writes `durability: "transient_local"` must not get
less in silence. A later version takes its word out of these tables.
"""

from typing import Final

from zacoustic.config.complaints import Place, shown

LATER_KEYS: Final = {
    "": {
        "ros": ("ROS 2", "types, topic, service and action of Zenoh"),
        "overlays": ("bounds for ROS 2 types", "bounds in types"),
    },
    "links": {},
    "streams": {
        "ros": ("ROS 2", "topic, service and action of Zenoh"),
        "deadline_s": ("deadlines", "lifespan_s"),
    },
}
"""Keys that are refused, what they are for and what is allowed instead, by the list that holds the
table; "" for the section."""

LATER_VALUES: Final = {
    "durability": {"transient_local": "volatile"},
    "stamp": {"time": "none, age"},
}
"""Values that are refused, and what is allowed instead, by key."""

_HINT: Final = "a later version will have it"


def refuse_later_keys(place: Place, table: str) -> None:
    """Refuse keys of the table at `place` that only a later version has.

    Args:
        place: A table of the file, or whatever stands there.
        table: The key of the list that holds it, "" for the section.

    Raises:
        ConfigError: Names the first such key.
    """
    if not isinstance(place.written, dict):
        return
    for key, (purpose, instead) in LATER_KEYS[table].items():
        if key in place.written:
            here = place.at(key)
            what = f"{shown(here.written)} is not available yet: {purpose}"
            here.complain(what, allowed=instead, hint=_HINT)


def check_word(place: Place, word: str, words: tuple[str, ...]) -> None:
    """Check a value that is one of a few words.

    Args:
        place: Where it is written.
        word: The value.
        words: What this version has.

    Raises:
        ConfigError: It is not one of them.
    """
    if word in words:
        return
    key = place.path.rpartition(".")[2]
    instead = LATER_VALUES.get(key, {}).get(word)
    if instead is not None:
        place.complain(f'"{word}" is not available yet', allowed=instead, hint=_HINT)
    place.complain(allowed=", ".join(words))
