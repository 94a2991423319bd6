"""Keys: names with placeholders, and what they stand for."""

import pytest

from zacoustic.core.streams.keys import MOST_VALUES, KeyPattern, Wildcard
from zacoustic.errors import ConfigError, UnknownStreamError

NODES = {1: "shore", 2: "auv1"}


def wildcard(name: str, *values: str) -> Wildcard:
    return Wildcard(name=name, values=values)


def pattern(name: str, *wildcards: Wildcard) -> KeyPattern:
    return KeyPattern(name, wildcards, NODES)


def test_plain_name_is_its_only_key() -> None:
    plain = pattern("auv1/nav")
    assert plain.key(7, ()) == "auv1/nav"
    assert plain.match("auv1/nav", 7) == ()
    assert plain.match("auv1/nav/x", 7) is None
    with pytest.raises(UnknownStreamError):
        plain.key(7, (0,))


def test_node_is_the_name_of_the_source() -> None:
    named = pattern("fleet/{node}/status")
    assert named.key(2, ()) == "fleet/auv1/status"
    assert named.match("fleet/auv1/status", 2) == ()
    assert named.match("fleet/shore/status", 2) is None
    with pytest.raises(UnknownStreamError, match="no key for node 3"):
        named.key(3, ())


def test_wildcards_are_numbered_in_the_order_of_the_name_not_of_the_list() -> None:
    both = pattern("a/{x}/{node}/b-{y}", wildcard("y", "0", "1"), wildcard("x", "p", "q", "r"))
    assert both.key(1, (2, 0)) == "a/r/shore/b-0"
    assert both.match("a/r/shore/b-0", 1) == (2, 0)
    assert both.match("a/z/shore/b-0", 1) is None
    for wrong in ((3, 0), (0,), (0, 0, 0), ()):
        with pytest.raises(UnknownStreamError):
            both.key(1, wrong)


def test_every_instance_matches_its_own_key_and_no_other() -> None:
    names = pattern("{a}/{b}", wildcard("a", "x", "x.y", "x+"), wildcard("b", "1", "11"))
    keys = {
        (first, second): names.key(1, (first, second)) for first in range(3) for second in (0, 1)
    }
    assert len(set(keys.values())) == 6
    for instance, key in keys.items():
        assert names.match(key, 1) == instance


def test_expression_covers_the_keys_by_zenoh_wildcards() -> None:
    both = pattern("a/{x}/{node}/b-{y}", wildcard("y", "0"), wildcard("x", "p"))
    assert both.expression(None) == "a/*/*/*"
    assert both.expression(2) == "a/*/auv1/*"
    assert both.expression(9) == "a/*/*/*"
    assert pattern("a/b").expression(None) == "a/b"


@pytest.mark.parametrize(
    ("name", "wildcards", "message"),
    [
        ("", (), "is empty"),
        ("/a", (), 'starts with "/"'),
        ("a//b", (), "empty chunk"),
        ("a/", (), "empty chunk"),
        ("a/*", (), r'contains "\*"'),
        ("a/**", (), r'contains "\*"'),
        ("a?b", (), r'contains "\?"'),
        ("a#", (), 'contains "#"'),
        ("a$b", (), r'contains "\$"'),
        ("@a", (), 'starts with "@"'),
        ("a/{x", (), "brace without its partner"),
        ("a/x}", (), "brace without its partner"),
        ("a/{x}", (), "has {x}, which is not listed"),
        ("a/{node}/{node}", (), "a placeholder twice"),
        ("a", (wildcard("x", "p"),), "does not occur"),
        ("a/{node}", (wildcard("node", "p"),), "not "),
        (
            "a/{x}",
            (wildcard("x"),),
            r"wildcards\[0\].values: \(\); allowed: a list of chunks of a key, 1..255",
        ),
        ("a/{x}", (wildcard("x", "p", "p"),), "p a second time; allowed: each once"),
        ("a/{x}", (wildcard("x", "p/q"),), "one chunk"),
        ("a/{x}", (wildcard("x", "*"),), "one chunk"),
        ("a/{x}", (wildcard("x", ""),), "one chunk"),
        ("a/{x}", (wildcard("x", *map(str, range(MOST_VALUES + 1))),), "1..255 of them"),
    ],
)
def test_wrong_name_is_refused_with_its_reason(
    name: str, wildcards: tuple[Wildcard, ...], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        pattern(name, *wildcards)
