"""The section `security`: what is read, what the key file must be, and what stays unread."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from zacoustic.config import read_config
from zacoustic.core.wire.seal import Way
from zacoustic.errors import ConfigError
from zacoustic.seal.keyring import open_keyring
from zacoustic.seal.keys import new_key, write_key
from zacoustic.seal.spec import Mode, SecuritySpec, Strong

_STREAMS = '[ { id: 7, topic: "auv1/stop" }, { id: 8, topic: "auv1/nav" } ]'


def _read(folder: Path, security: str) -> SecuritySpec | None:
    path = folder / "fleet.json5"
    path.write_text(
        f"{{ plugins: {{ acoustic: {{ address: 2, streams: {_STREAMS}{security} }} }} }}"
    )
    return read_config(path).security


def _spec(folder: Path, security: str = "") -> SecuritySpec:
    spec = _read(folder, f', security: {{ key: "fleet.key"{security} }}')
    assert spec is not None
    return spec


def test_without_the_section_there_is_no_seal(tmp_path: Path) -> None:
    assert _read(tmp_path, "") is None


def test_defaults_are_the_safe_ones_and_files_lie_beside_the_configuration(tmp_path: Path) -> None:
    spec = _spec(tmp_path)
    assert spec.key == tmp_path / "fleet.key"
    assert spec.lives == tmp_path / "lives"
    assert spec.mode is Mode.ENCRYPT
    assert spec.strong == frozenset(Strong)
    assert (spec.pad, spec.unsealed) == ((), frozenset())


def test_everything_that_is_written_is_read(tmp_path: Path) -> None:
    spec = _spec(
        tmp_path,
        ', mode: "authenticate", strong: ["commands"], pad: [16, 32], overlap_s: 60, '
        'lives: "/var/lib/x", emergency: { unsealed: ["auv1/stop"] }',
    )
    assert spec.mode is Mode.AUTHENTICATE
    assert spec.strong == {Strong.COMMANDS}
    assert (spec.pad, spec.overlap_s, spec.lives) == ((16, 32), 60, Path("/var/lib/x"))
    assert spec.unsealed == {7}


def test_a_seal_on_a_foreign_wire_is_refused(tmp_path: Path) -> None:
    links = ', links: [ { locator: "sim/h:1", wire: "rmw_desert" } ], security: { key: "k" }'
    with pytest.raises(ConfigError, match=r'security: .*with wire: "rmw_desert".*no room'):
        _read(tmp_path, links)


def test_the_key_file_gives_cipher_and_lives_of_the_node(tmp_path: Path) -> None:
    write_key(tmp_path / "fleet.key", new_key("harbour"))
    ring = open_keyring(_spec(tmp_path), 2)
    way, number = Way(2, 1), bytes(13)
    body = ring.cipher.seal(way, number, b"records", b"head")
    assert ring.cipher.open(0, way, number, body, b"head") == b"records"
    assert ring.lives.paths[0].parent == tmp_path / "lives"
    assert not (tmp_path / "lives").exists()
    assert ring.key.network == "harbour"


def test_frames_of_the_former_generation_are_opened_until_the_overlap_ends(tmp_path: Path) -> None:
    old = new_key("harbour")
    write_key(tmp_path / "fleet.key", old)
    way, number = Way(1, 2), bytes(13)
    body = open_keyring(_spec(tmp_path), 1).cipher.seal(way, number, b"records", b"head")
    write_key(tmp_path / "fleet.key", old.rotated(), replace=True)
    cipher = open_keyring(_spec(tmp_path), 2).cipher
    assert cipher.open(0, way, number, body, b"head") == b"records"
    cipher.end_overlap()
    assert cipher.open(0, way, number, body, b"head") is None


def _no_file(path: Path) -> None:
    del path


def _readable_by_others(path: Path) -> None:
    write_key(path, new_key("harbour"))
    path.chmod(0o640)


def _damaged(path: Path) -> None:
    path.write_bytes(b"{}")
    path.chmod(0o600)


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (_no_file, "No such file or directory (make one with `zacoustic key new`)"),
        (_readable_by_others, "others may read it, mode 0640; allowed: 0600 (chmod 600 "),
        (_damaged, "no key file: "),
    ],
)
def test_a_key_file_that_cannot_be_used_is_one_line_with_its_place(
    tmp_path: Path, make: Any, expected: str
) -> None:
    spec = _spec(tmp_path)
    make(spec.key)
    with pytest.raises(ConfigError) as caught:
        open_keyring(spec, 2)
    message = str(caught.value)
    where = f"{tmp_path}/fleet.json5: plugins.acoustic.security.key: {tmp_path}/fleet.key: "
    assert message.startswith(where + expected)
    assert "\n" not in message


def test_without_cryptography_the_file_is_read_and_the_extra_is_named(tmp_path: Path) -> None:
    write_key(tmp_path / "fleet.key", new_key("harbour"))
    _spec(tmp_path)
    script = (
        "import sys; sys.modules['cryptography'] = None\n"
        "from zacoustic.config import read_config\n"
        "from zacoustic.errors import ConfigError\n"
        "from zacoustic.seal.keyring import open_keyring\n"
        f"spec = read_config({str(tmp_path / 'fleet.json5')!r}).security\n"
        "try: open_keyring(spec, 2)\n"
        "except ConfigError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert "security: needs cryptography, which is not installed" in done.stdout
    assert "pip install '.[secure]'" in done.stdout
