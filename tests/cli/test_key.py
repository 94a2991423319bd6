"""`zacoustic key`: what each sub-verb does to files, prints, and never prints."""

import base64
import json
from pathlib import Path

import pytest

from zacoustic.app.cli import main
from zacoustic.config import read_config
from zacoustic.core.wire.seal import Way
from zacoustic.run.journal import journal_in
from zacoustic.run.journal.lives import LifeJournal
from zacoustic.seal.keyring import open_keyring
from zacoustic.seal.keys import FleetKey, read_key
from zacoustic.seal.spec import SecuritySpec

_CONFIG = """{ plugins: { acoustic: {
  nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv1" } ], journal: "journal",
  security: { key: "fleet.key" }, streams: [ { id: 1, topic: "hello" } ] } } }"""


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """A configuration with a new key beside it."""
    path = tmp_path / "fleet.json5"
    path.write_text(_CONFIG)
    assert main(["key", "new", str(tmp_path / "fleet.key"), "--network", "harbour"]) == 0
    return path


def _key(fleet: Path) -> FleetKey:
    return read_key(fleet.with_name("fleet.key"))


def _start(fleet: Path) -> None:
    """Start node 2 once."""
    config = read_config(fleet, address=2)
    assert config.journal is not None
    lives = open_keyring(_security(fleet), 2).lives
    journal = LifeJournal(journal_in(config.journal, 2), lives)
    journal.recover()
    journal.close()


def _printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    capsys.readouterr()
    code = main(list(arguments))
    written = capsys.readouterr()
    return code, written.out + written.err


@pytest.mark.parametrize("verb", ["new", "show", "rotate", "revoke", "rejoin", "check"])
def test_each_sub_verb_has_help_with_an_example(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text = _printed(capsys, "key", verb, "--help")
    assert code == 0
    assert f"zacoustic key {verb} " in text.partition("example")[2]


def test_a_new_key_is_private_and_is_not_written_over(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, key = fleet.with_name("fleet.key"), _key(fleet)
    assert path.stat().st_mode & 0o777 == 0o600
    code, text = _printed(capsys, "key", "new", str(path), "--network", "harbour")
    assert (code, _key(fleet)) == (2, key)
    assert "there is a key already" in text
    assert text.count("\n") == 1
    assert main(["key", "new", str(path), "--network", "harbour", "--force"]) == 0
    assert _key(fleet).secret != key.secret
    assert _key(fleet).generation == 1, "lives of generation 0 were used with the other secret"


@pytest.mark.parametrize("network", ["", "x" * 65, "a\nb"])
def test_a_network_without_a_name_is_refused(
    network: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text = _printed(capsys, "key", "new", str(tmp_path / "k"), "--network", network)
    assert code == 2
    assert "allowed: 1..64 bytes" in text
    assert list(tmp_path.iterdir()) == []


def test_no_sub_verb_prints_a_secret(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, config = str(fleet.with_name("fleet.key")), str(fleet)
    first = _key(fleet)
    text = ""
    for arguments in (
        ("show", path), ("show", path, "--json"), ("rotate", path), ("show", path, "--json"),
        ("check", config, "--address", "2"), ("check", config, "--address", "2", "--json"),
        ("rejoin", "2", "--config", config, "--never"), ("revoke", path, "2"),
        ("rejoin", "2", "--config", config, "--never", "--yes", "--json"),
        ("new", path, "--network", "harbour"), ("new", path, "--network", "harbour", "--force"),
    ):  # fmt: skip
        text += _printed(capsys, "key", *arguments)[1]
    assert text.count(first.fingerprint) == 2, "of the first key, as long as that is there"
    for key in (first, _key(fleet)):
        for form in (key.secret.hex(), base64.b64encode(key.secret).decode(), repr(key.secret)):
            assert form not in text


def test_show_says_which_key_it_is(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = fleet.with_name("fleet.key")
    code, text = _printed(capsys, "key", "show", str(path), "--json")
    assert code == 0
    assert json.loads(text) == {
        "file": str(path), "network": "harbour", "generation": 0,
        "fingerprint": _key(fleet).fingerprint, "opens_former": False,
    }  # fmt: skip
    path.chmod(0o644)
    code, text = _printed(capsys, "key", "show", str(path))
    assert code == 2
    assert "others may read it, mode 0644; allowed: 0600" in text


def test_rotate_keeps_the_former_generation_until_the_overlap_ends(fleet: Path) -> None:
    first, path = _key(fleet), fleet.with_name("fleet.key")
    link = fleet.with_name("link.key")
    link.symlink_to(path)
    assert main(["key", "rotate", str(link)]) == 0
    second = _key(fleet)
    assert link.is_symlink()
    assert (second.generation, second.former) == (1, first.secret)
    assert main(["key", "rotate", str(path), "--end-overlap"]) == 0
    assert _key(fleet) == second.settled()
    assert main(["key", "rotate", str(path), "--end-overlap"]) == 2
    assert path.stat().st_mode & 0o777 == 0o600


def test_revoke_says_that_a_fleet_key_has_no_members(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = _key(fleet)
    code, text = _printed(capsys, "key", "revoke", str(fleet.with_name("fleet.key")), "2")
    assert (code, _key(fleet)) == (2, key)
    assert "node 2 cannot be taken out of it (`zacoustic key rotate`" in text


def test_rejoin_explains_the_danger_and_acts_only_when_it_is_accepted(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lives = open_keyring(_security(fleet), 2).lives
    rejoin = ("key", "rejoin", "2", "--config", str(fleet))
    code, text = _printed(capsys, *rejoin, "--never")
    assert code == 2
    assert "anybody who has recorded both can read" in text
    assert not lives.paths[0].exists()
    assert main([*rejoin, "--yes"]) == 2, "what is known has to be said"
    assert main([*rejoin, "--never", "--yes"]) == 0
    begun = lives.begin()
    code, text = _printed(capsys, *rejoin, "--never", "--yes")
    assert code == 1
    assert f"has a record, life {begun} (start the node" in text
    for path in lives.paths:
        path.unlink()
    assert main([*rejoin, "--after", "41", "--yes"]) == 0
    assert lives.begin() > 41


def _security(fleet: Path, address: int = 2) -> SecuritySpec:
    security = read_config(fleet, address=address).security
    assert security is not None
    return security


def test_check_names_what_is_wrong_and_nothing_when_nothing_is(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key_file, check = fleet.with_name("fleet.key"), ("key", "check", str(fleet), "--address", "2")
    code, text = _printed(capsys, *check)
    assert code == 1
    assert "no record of the lives of node 2" in text
    assert "zacoustic key rejoin 2" in text
    assert main(["key", "rejoin", "2", "--config", str(fleet), "--never", "--yes"]) == 0
    code, text = _printed(capsys, *check, "--fingerprint", _key(fleet).fingerprint.upper())
    assert (code, "nothing found" in text) == (0, True)
    code, text = _printed(capsys, *check, "--fingerprint", "00000000", "--json")
    assert code == 1
    told = json.loads(text)
    assert told["fingerprint"] == _key(fleet).fingerprint
    assert ", not 00000000" in told["findings"][0]["what"]
    assert main([*check, "--fingerprint", "no"]) == 2

    lives = open_keyring(_security(fleet), 2).lives
    _start(fleet)
    lives.paths[1].write_bytes(b"")
    code, text = _printed(capsys, *check)
    assert code == 1
    assert f"{lives.paths[1]}: 0 bytes that are no record" in text
    _start(fleet)
    assert main([*check]) == 0
    lives.begin()  # what the journal does not know
    code, text = _printed(capsys, *check)
    assert "old journal: " in text
    assert "is of life 2, and the last start was life 3: an old copy was put back" in text
    assert code == 1
    _start(fleet)
    old_records = [path.read_bytes() for path in lives.paths]
    for _ in range(2):
        _start(fleet)
    for path, content in zip(lives.paths, old_records, strict=True):
        path.write_bytes(content)
    code, text = _printed(capsys, *check)
    assert "is of life 6, and the records are of life 4" in text
    assert code == 1
    _start(fleet)
    assert main([*check]) == 0

    old = key_file.read_bytes()
    assert main(["key", "rotate", str(key_file)]) == 0
    open_keyring(_security(fleet), 2).lives.begin()
    key_file.write_bytes(old)
    code, text = _printed(capsys, *check)
    assert "has started with generation 1 of the key, and the key file has 0" in text
    assert code == 1

    key_file.chmod(0o604)
    code, text = _printed(capsys, *check)
    assert "others may read it, mode 0604" in text
    assert code == 1
    key_file.unlink()
    code, text = _printed(capsys, *check)
    assert "plugins.acoustic.security.key: " in text
    assert code == 1


def test_check_of_a_node_without_seal_or_journal_says_so(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["key", "rejoin", "2", "--config", str(fleet), "--never", "--yes"]) == 0
    check = ("key", "check", str(fleet), "--address", "2")
    fleet.write_text(_CONFIG.replace('journal: "journal",', ""))
    code, text = _printed(capsys, *check)
    assert (code, "plugins.acoustic.journal: is missing" in text) == (1, True)
    fleet.write_text(_CONFIG.replace('security: { key: "fleet.key" },', ""))
    code, text = _printed(capsys, *check)
    assert (code, "plugins.acoustic.security: is missing" in text) == (1, True)
    assert main(["key", "rejoin", "2", "--config", str(fleet), "--never", "--yes"]) == 2


def test_identities_are_enrolled_rotated_and_revoked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keys = tmp_path / "keys"
    keys.mkdir()
    listed = keys / "fleet.members"
    for address in (1, 2, 3):
        new = ("key", "new", str(keys / f"n{address}.identity"), "--network", "harbour")
        assert main([*new, "--identity", str(address), "--members", str(listed)]) == 0
        assert main([*new, "--identity", str(address), "--members", str(listed)]) == 2
    assert main([*new, "--identity", "3"]) == 2
    code, text = _printed(capsys, "key", "show", str(listed), "--json")
    told = json.loads(text)
    assert (code, told["members"], told["unheard"], told["generation"]) == (0, [1, 2, 3], [], 0)

    assert main(["key", "rotate", str(listed)]) == 0
    code, text = _printed(capsys, "key", "show", str(listed))
    assert "generation 1" in text
    assert "opens generation 0 too" in text
    (keys / "n3.identity").unlink()
    code, text = _printed(capsys, "key", "revoke", str(listed), "2")
    assert code == 0
    assert "members: 1, 3" in text
    assert "not everybody opens broadcasts of node 3" in text
    code, text = _printed(capsys, "key", "revoke", str(listed), "2")
    assert code == 2
    assert "node 2 is not in the list; allowed: 1, 3" in text


def test_a_node_with_an_identity_seals_with_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = tmp_path / "fleet.members"
    for address in (1, 2):
        new = ("key", "new", str(tmp_path / f"n{address}.identity"), "--network", "harbour")
        assert main([*new, "--identity", str(address), "--members", str(listed)]) == 0
    rings = {}
    for address in (1, 2):
        path = tmp_path / f"n{address}.json5"
        key = f'security: {{ key: "n{address}.identity", members: "fleet.members" }}'
        path.write_text(_CONFIG.replace('security: { key: "fleet.key" }', key))
        rings[address] = open_keyring(_security(path, address), address)
    way, number = Way(1, 2), bytes(13)
    body = rings[1].cipher.seal(way, number, b"records", b"head")
    assert rings[2].cipher.open(0, way, number, body, b"head") == b"records"
    assert main(["key", "rejoin", "2", "--config", str(path), "--never", "--yes"]) == 0
    assert main(["key", "check", str(path), "--address", "2"]) == 0
    code, text = _printed(capsys, "key", "check", str(path), "--address", "1")
    assert code == 1
    assert "is of node 2; allowed: of node 1" in text
    assert main(["key", "revoke", str(listed), "2"]) == 0
    code, text = _printed(capsys, "key", "check", str(path), "--address", "2")
    assert code == 1
    assert "plugins.acoustic.security.members: harbour: node 2 is not in the list" in text
