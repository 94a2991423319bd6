"""`zacoustic key send`, from a client of the shore's router to a gateway beyond the channel."""

import contextlib
import json
from pathlib import Path

import pytest

from tests.gateway.networkpair import verb
from tests.gateway.networks import SECTION, Channel, config_of, free_port, run, zenoh_config
from zacoustic.gateway import Gateway
from zacoustic.run.audit import read_audit
from zacoustic.seal.identities import Members, new_identity, write_identity, write_members
from zacoustic.seal.keyring import open_keyring


def _lists(folder: Path) -> None:
    """Node 3 is on the shore's list, and not on the vehicle's, which dived before."""
    identities = {address: new_identity("harbour", address) for address in (1, 2, 3)}
    for address, identity in identities.items():
        write_identity(folder / f"{address}.identity", identity)
    for name, listed in (("2.members", (1, 2)), ("1.members", (1, 2, 3))):
        made = Members(network="harbour")
        for address in listed:
            made = made.joined(identities[address])
        for address in listed:
            made = made.wrapped_by(identities[address])
        write_members(folder / name, made)


def test_verb_sends_a_key_and_says_what_it_took_or_why_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _lists(tmp_path)
    port = free_port()

    async def scene() -> list[int]:
        channel = Channel(profile="evologics_s2c_18_34", time_scale=20)
        async with contextlib.AsyncExitStack() as stack:
            for address, settings in (
                (1, zenoh_config("router", listen=port)),
                (2, zenoh_config("router", listen=free_port())),
            ):
                security = {
                    "key": str(tmp_path / f"{address}.identity"),
                    "members": str(tmp_path / f"{address}.members"),
                    "lives": str(tmp_path / f"lives-{address}"),
                }
                config = config_of(address, settings, SECTION | {"security": security})
                assert config.security is not None
                open_keyring(config.security, address).lives.join()
                await stack.enter_async_context(
                    Gateway(
                        config, link=channel.medium.link(address), journal=tmp_path / str(address)
                    )
                )
            where = ["--connect", f"tcp/127.0.0.1:{port}"]
            send = ["key", "send", "--node", "2", "--source"]
            return [
                await verb(*send, "3", "--json", *where),
                await verb(*send, "1", *where),  # its list has that
                await verb(*send, "9", *where),  # the shore itself has no such key
                await verb("key", "send", "--node", "1", "--source", "3", *where),
                await verb("key", "send", "--node", "300", "--source", "3", *where),
            ]

    assert run(scene()) == [0, 1, 1, 1, 2]
    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert (answer["address"], answer["source"], answer["by"]) == (2, 3, 1)
    assert 0.5 < 20 * answer["airtime_s"] < 2, "the channel runs twenty times as fast"
    for text in (
        "refused by node 2: the list has a key for broadcasts of node 1",
        "this node does not open broadcasts of node 9 itself",
        "node 1 is on this local network: copy the list to it",
        "--node 300; allowed: 1..254",
    ):
        assert text in said.err
    assert (tmp_path / "lives-2" / "node-2.delivered").exists()
    (audit,) = (tmp_path / "1").glob("*.audit")
    own = [(each.to, each.about, each.outcome) for each in read_audit(audit) if each.what == "key"]
    assert own == [
        (2, f"broadcasts of node {source}", outcome)
        for source, ended in ((3, "answered"), (1, "failed"))
        for outcome in ("asked", ended)
    ]
    (audit,) = (tmp_path / "2").glob("*.audit")
    noted = [(each.by, each.outcome, each.text) for each in read_audit(audit) if each.what == "key"]
    assert noted == [
        (1, "executed", "for broadcasts of node 3"),
        (1, "refused", "the list has a key for broadcasts of node 1"),
    ]
