"""Key files: who may read them, what is in them, what no message shows."""

import random
from pathlib import Path

import pytest

from zacoustic.core.wire.seal import Way
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import FleetKey, KeyFileError, expand, new_key, read_key, write_key


def test_a_key_comes_back_and_only_its_owner_may_read_it(tmp_path: Path) -> None:
    key, path = new_key("harbour"), tmp_path / "fleet.key"
    write_key(path, key)
    assert (read_key(path), path.stat().st_mode & 0o777) == (key, 0o600)
    with pytest.raises(KeyFileError, match="there is a key already"):
        write_key(path, key)
    write_key(path, key.rotated(), replace=True)
    assert read_key(path).generation == 1
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_key_that_others_may_read_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "fleet.key"
    write_key(path, new_key("harbour"))
    path.chmod(mode)
    with pytest.raises(KeyFileError, match="others may read it"):
        read_key(path)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{}",
        b"\xff",
        b'{"network":"x","generation":0,"secret":"AAAA"}',
        random.Random(1).randbytes(90),
    ],
)
def test_what_is_no_key_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "fleet.key"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(KeyFileError, match=r"fleet\.key: "):
        read_key(path)


def test_no_text_of_a_key_shows_a_secret() -> None:
    key = new_key("harbour").rotated()
    assert key.former is not None
    for secret in (key.secret, key.former):
        for text in (repr(key), str(key), key.fingerprint):
            assert secret.hex() not in text
            assert repr(secret) not in text


def test_nodes_networks_and_generations_share_no_key() -> None:
    secret = bytes(32)
    keys = [
        FleetKey(network=network, generation=generation, secret=secret)
        for network in ("a", "b")
        for generation in (0, 1, 256)
    ]
    made = {key.node_key(address) for key in keys for address in (1, 2, 254)}
    assert len(made) == len(keys) * 3


def test_frames_of_the_generation_before_are_opened_until_it_is_dropped() -> None:
    old = new_key("harbour")
    new, way, number = old.rotated(), Way(1, 2), bytes(13)
    body = FleetCipher(old).seal(way, number, b"records", b"associated")
    assert FleetCipher(new).open(0, way, number, body, b"associated") == b"records"
    dropped = FleetKey(network=new.network, generation=1, secret=new.secret)
    assert FleetCipher(dropped).open(0, way, number, body, b"associated") is None


def test_expand_is_that_of_rfc_5869() -> None:
    # Appendix A.1: pseudorandom key, info, length and output.
    secret = bytes.fromhex("077709362c2e32df0ddc3f0dc47bba6390b6c73bb50f9c3122ec844ad7c2b3e5")
    info = bytes.fromhex("f0f1f2f3f4f5f6f7f8f9")
    assert expand(secret, info, 42).hex() == (
        "3cb25f25faacd57a90434f64d0362f2a2d2d0a90cf1a5a4c5db02d56ecc4c5bf34007208d5b887185865"
    )
