"""The page of links: every setting is on it, with the range that the link declares."""

import re
from pathlib import Path

import pytest

from zacoustic.link.registry import load
from zacoustic.text.allowed import allowed, table_of

PAGE = (Path(__file__).parents[2] / "docs" / "links.md").read_text(encoding="utf-8")
LINKS = ("sim", "udp", "iridium", "desert", "evologics")


def rows_of(name: str) -> list[tuple[set[str], str]]:
    """Keys and text of each row about the settings of a link."""
    section = next(each for each in PAGE.split("\n## ")[1:] if f"`{name}/" in each.split("\n")[0])
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|(.*)\|$", section, re.MULTILINE)
    return [({*re.findall(r"\w+", keys)}, text) for keys, text in rows]


@pytest.mark.parametrize("name", LINKS)
def test_every_setting_is_on_the_page(name: str) -> None:
    shown = {key for keys, _ in rows_of(name) for key in keys}
    assert {field.encode_name for field in table_of(load(name).config_type).fields} <= shown


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("desert", "max_read_length"),
        ("evologics", "baudrate"),
        ("evologics", "mtu"),
        ("evologics", "retries"),
    ],
)
def test_range_on_the_page_is_the_one_that_the_setting_declares(name: str, key: str) -> None:
    fields = {each.name: each.type for each in table_of(load(name).config_type).fields}
    declared = re.search(r"[0-9]+\.\.[0-9]+", allowed(fields[key]))
    assert declared is not None
    text = next(text for keys, text in rows_of(name) if key in keys)
    assert declared[0].replace("..", "…") in text
