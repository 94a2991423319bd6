"""Each mistake is one line with the file, the key, the value and what is allowed."""

import pytest

from tests.config.mistakes import MISTAKES
from tests.config.section import ROOT, changed, message_of


@pytest.mark.parametrize(("path", "value", "expected"), MISTAKES)
def test_mistake_is_one_line_with_file_key_value_and_what_is_allowed(
    path: str, value: object, expected: str
) -> None:
    message = message_of(changed(path, value))
    assert message.startswith(f"{ROOT}.")
    assert expected in message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize("section", [None, [], 3, "text"])
def test_section_that_is_no_table_is_refused(section: object) -> None:
    assert message_of(section).startswith(f"{ROOT}: ")
    assert message_of(section).endswith(
        "{ address, nodes, links, types, journal, streams, ranging }"
    )
