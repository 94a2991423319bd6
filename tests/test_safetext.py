"""What makes texts of others safe to show, and that everything printed passes through it."""

import ast
import math
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import zacoustic
from tests.hostilenames import HOSTILE, assert_harmless, strictly
from zacoustic.text.safetext import html_text, json_line, one_line, some_lines, without_secrets

TEXTS = st.text(st.characters(), max_size=40)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=10,
)


@given(TEXTS)
def test_any_text_becomes_one_line_that_can_only_be_shown(text: str) -> None:
    assert one_line(text).isprintable()
    assert one_line(one_line(text)) == one_line(text)
    assert all(line.isprintable() for line in some_lines(text).split("\n"))


def test_what_is_readable_stays_as_it_is() -> None:
    text = "Tiefe 12,5 m · 10 % → 潜水艇 [bracket] \\ ° “x”"
    assert one_line(text) == text
    assert one_line("a\x1bb\n\u202ec") == "a\\x1bb\\n\\u202ec"
    assert some_lines("a\nb\x1b") == "a\nb\\x1b"


@given(VALUES)
def test_json_is_one_printable_line_and_gives_back_what_was_there(value: object) -> None:
    line = json_line(value)
    assert line.isprintable()
    assert strictly(line) == without_nan(value)


def without_nan(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: without_nan(each) for key, each in value.items()}
    return [without_nan(each) for each in value] if isinstance(value, list) else value


@given(TEXTS)
def test_html_has_no_tag_also_inside_an_attribute(text: str) -> None:
    tags: list[tuple[str, dict[str, str | None]]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            tags.append((tag, dict(attrs)))

    shown = html_text(text + HOSTILE)
    Reader().feed(f'<p title="{shown}">{shown}</p>')
    assert tags == [("p", {"title": one_line(text + HOSTILE)})]


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("tcp/admin:geheim@10.0.0.1:7447", "tcp/admin:***@10.0.0.1:7447"),
        ("no router at tls/u:p%20w@h:1, tcp/h:2", "no router at tls/u:***@h:1, tcp/h:2"),
        ("tls/h:7447#password=abc;x=1", "tls/h:7447#password=***;x=1"),
        ("modem/h#api_key=k&user_token=t&n=2", "modem/h#api_key=***&user_token=***&n=2"),
        ("evologics/tcp:192.168.0.209:9200#tx=1", "evologics/tcp:192.168.0.209:9200#tx=1"),
        ("tcp/[::1]:7447", "tcp/[::1]:7447"),
    ],
)
def test_passwords_of_endpoints_and_locators_are_hidden(said: str, shown: str) -> None:
    assert without_secrets(said) == shown


def test_verbs_print_through_one_place() -> None:
    """What a verb prints past it could hold the escapes of others."""
    folder = Path(zacoustic.__file__).parent / "app" / "cli"
    past = [
        f"{path.name}:{node.lineno}: {ast.unparse(node.func)}"
        for path in sorted(folder.glob("*.py"))
        if path.name not in ("printing.py", "atwork.py")  # the latter prints nothing of others
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and ast.unparse(node.func)
        in ("print", "json.dumps", "sys.stdout.write", "sys.stderr.write")
    ]
    assert past == []


def test_hostile_text_is_one() -> None:
    with pytest.raises(AssertionError):
        assert_harmless(HOSTILE)
    assert_harmless(one_line(HOSTILE))
