import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.errors import ConfigError
from zacoustic.json5 import parse_json5, read_json5, read_zenoh_config

LINE_ENDS = "\u2028\u2029"
"""What Zenoh's parser takes for the end of a line, also within a text: a file has to escape it."""
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"], exclude_characters=LINE_ENDS), max_size=20)
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("abc_", min_size=1), inner),
    max_leaves=20,
)


@given(VALUES)
def test_any_json_value_is_read_back(value: object) -> None:
    text = json.dumps(value, ensure_ascii=False)
    assert parse_json5(text, source="test") == value


@pytest.mark.parametrize("end", LINE_ENDS)
def test_line_end_of_unicode_within_a_text_is_escaped_or_refused(end: str) -> None:
    assert parse_json5(json.dumps(f"a{end}b"), source="test") == f"a{end}b"
    with pytest.raises(ConfigError, match="test:1:3"):
        parse_json5(f'"a{end}b"', source="test")


def test_what_json5_adds_to_json_is_understood() -> None:
    text = "// a comment\n{ seed: 0x10, 'wind': +.5, /* here */ names: ['a', \"b\",], }// end"
    assert parse_json5(text, source="test") == {"seed": 16, "wind": 0.5, "names": ["a", "b"]}


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("{a: 1,\n b: }", "2:5"),
        ("{\n\n  a: @ }", "3:6"),
        ("", "1:1"),
        ("{", "1:2"),
        ("{a: 1}}, mode: 'peer'", "1:7"),
        ("{a: 1}, mode: 'peer'", "1:7"),
        ("{a: 1}\n}", "2:1"),
        ("// only a comment", "1:18"),
    ],
)
def test_syntax_error_names_line_and_column_of_the_users_text(text: str, place: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_json5(text, source="water.json5")
    assert str(caught.value).startswith(f"water.json5:{place}: expected ")
    assert "\n" not in str(caught.value)


def test_too_large_number_is_refused_and_not_rounded() -> None:
    with pytest.raises(ConfigError, match=r"^x: a number is too large; allowed: 64 bits$"):
        parse_json5("{a: 123456789012345678901234567890}", source="x")


def test_text_that_would_overflow_the_parser_is_refused(tmp_path: Path) -> None:
    text = "\n" + 100_000 * "["
    with pytest.raises(ConfigError, match=r"^x:2: nested 201 deep; allowed: 200$"):
        parse_json5(text, source="x")
    with pytest.raises(ConfigError, match=r":2: nested 201 deep"):
        read_zenoh_config(config_file(tmp_path, text))
    assert parse_json5(200 * "[" + 200 * "]", source="x")


def test_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    for path, reason in [
        (tmp_path / "none.json5", "No such file or directory"),
        (tmp_path, "Is a directory"),
    ]:
        with pytest.raises(ConfigError, match=re.escape(f"{path}: {reason}")):
            read_json5(path)
    latin = tmp_path / "latin.json5"
    latin.write_bytes(b"{a: '\xe9'}")
    with pytest.raises(ConfigError, match="byte 5 is not UTF-8"):
        read_json5(latin)


def test_file_with_byte_order_mark_has_the_right_columns(tmp_path: Path) -> None:
    path = tmp_path / "windows.json5"
    path.write_bytes(b"\xef\xbb\xbf{a:}")
    with pytest.raises(ConfigError, match=r":1:4: expected"):
        read_json5(path)


def config_file(tmp_path: Path, text: str, name: str = "router.json5") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_zenoh_config_gives_itself_and_our_section(tmp_path: Path) -> None:
    path = config_file(
        tmp_path,
        "{ mode: 'router', plugins: { acoustic: { address: 2, streams: [{id: 1}] } } }",
    )
    config, section = read_zenoh_config(path)
    assert config is not None
    assert json.loads(config.get_json("mode")) == "router"
    assert section == {"address": 2, "streams": [{"id": 1}]}


def test_yaml_config_is_read_too(tmp_path: Path) -> None:
    path = config_file(tmp_path, "mode: client\nplugins: {acoustic: {address: 3}}\n", "r.yaml")
    assert read_zenoh_config(path)[1] == {"address": 3}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{ mode: 'router' }", "{path}: no section plugins.acoustic (add "),
        ("{ mode: 'router', plugins: { other: {} } }", "{path}: no section plugins.acoustic (add "),
        ("{\n  mode: }", "{path}:2:9: expected "),
        ("{ mode: 'ruter' }", "{path}:1:9: unknown variant `ruter`"),
        ("{ foo: 1 }", "{path}:1:3: unknown field `foo`"),
        ("{ nodes: [] }", "{path}: no section plugins.acoustic (it looks like a scenario"),
        ("{ mode: 'peer' } }", "{path}:1:18: expected the end of the file"),
        ("{ plugins: { acoustic: 5 } }", "{path}: plugins.acoustic must be object"),
    ],
)
def test_wrong_zenoh_config_says_file_and_place(tmp_path: Path, text: str, message: str) -> None:
    path = config_file(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        read_zenoh_config(path)
    assert str(caught.value).startswith(message.format(path=path))
    assert ".rs" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_zenoh_config_is_named(tmp_path: Path) -> None:
    path = tmp_path / "none.json5"
    with pytest.raises(ConfigError, match=re.escape(f"{path}: No such file or directory")):
        read_zenoh_config(path)
