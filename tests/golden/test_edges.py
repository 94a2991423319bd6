"""The vectors of rules that no other file decides are what the script makes."""

from tests.golden.edges import VECTORS, text


def test_file_is_written_as_the_script_writes_it() -> None:
    assert VECTORS.read_text(encoding="utf-8") == text()
