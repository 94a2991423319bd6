"""The file of delivered keys: kept across starts, and no reason not to start."""

import logging
from pathlib import Path

import pytest

from zacoustic.seal.deliveredkeys import DeliveredKey, DeliveredKeys

KEY = DeliveredKey(sender=1, wrapped=bytes(range(40)))


def test_a_key_is_there_after_a_restart_in_its_generation_only(tmp_path: Path) -> None:
    path = tmp_path / "lives" / "node-3.delivered"
    DeliveredKeys("bay", 2, path).keep(5, KEY)
    assert DeliveredKeys("bay", 2, path).of == {5: KEY}
    assert not DeliveredKeys("bay", 3, path).of
    assert not DeliveredKeys("other", 2, path).of


@pytest.mark.parametrize("damage", [b"", b"\x00" * 64, b'{"network": "bay"', b'{"of": 3}'])
def test_a_damaged_file_is_logged_and_replaced(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, damage: bytes
) -> None:
    path = tmp_path / "node-3.delivered"
    path.write_bytes(damage)
    path.chmod(0o600)
    with caplog.at_level(logging.ERROR):
        keys = DeliveredKeys("bay", 2, path)
    assert not keys.of
    assert str(path) in caplog.text
    assert "send them again" in caplog.text
    keys.keep(5, KEY)
    assert DeliveredKeys("bay", 2, path).of == {5: KEY}


def test_a_file_that_others_may_read_is_not_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "node-3.delivered"
    DeliveredKeys("bay", 2, path).keep(5, KEY)
    path.chmod(0o644)
    assert not DeliveredKeys("bay", 2, path).of
    assert "others may read it" in caplog.text
