"""Words of the configuration's format that this version does not have yet.

They are refused by name, never ignored: who writes `stamp: "time"` must not get less in silence. A
later version takes its word out of this table.
"""

from typing import Final

from zacoustic.config.problems import Place

LATER_VALUES: Final = {
    "stamp": {"time": "none, age"},
}
"""Values that are refused, and the allowed ones, by key."""

_HINT: Final = "a later version will have it"


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
        place.refuse(f'"{word}" is not available yet', allowed=instead, hint=_HINT)
    place.refuse(allowed=", ".join(words))
