"""Words of the configuration's format that this version does not have yet.

Reading refuses them by name and never ignores them: a user of `stamp: "time"` must not silently get
less. The version that adds a word removes it from this table.
"""

from typing import Final

from zacoustic.config.problems import Place

LATER_VALUES: Final = {
    "stamp": {"time": "none, age"},
}
"""Refused values and the allowed ones instead, by key."""

_HINT: Final = "a later version will have it"


def check_word(place: Place, word: str, words: tuple[str, ...]) -> None:
    """Check a value that is one of a few words.

    Args:
        place: Place of the value.
        word: The value.
        words: The words of this version.

    Raises:
        ConfigError: The value is not one of them.
    """
    if word in words:
        return
    key = place.path.rpartition(".")[2]
    instead = LATER_VALUES.get(key, {}).get(word)
    if instead is not None:
        place.refuse(f'"{word}" is not available yet', allowed=instead, hint=_HINT)
    place.refuse(allowed=", ".join(words))
