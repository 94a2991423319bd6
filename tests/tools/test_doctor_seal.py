"""`zacoustic config doctor` beside a key: each fault of a seal is made for real and named."""

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tests.gateway.networks import (
    Channel,
    LocalNetwork,
    config_of,
    free_port,
    run,
    until,
    zenoh_config,
)
from tests.tools.ward import NODES, STREAMS, beside, examine, modem_file, problem
from zacoustic.app.cli import main
from zacoustic.app.tools.security.keycheck import check_room, check_running
from zacoustic.config import Config, config_from_mapping
from zacoustic.core.engine.events import SealAlarm
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.peers.sealing import SealRefusal
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.gateway import Gateway
from zacoustic.run.journal import journal_in
from zacoustic.seal.keys import FleetKey, new_key, read_key, write_key
from zacoustic.zenoh.gateway.events.said import said
from zacoustic.zenoh.gateway.status.recent_events import RecentEvents

KEY = new_key("harbour")
EAGER = [{**STREAMS[0], "min_interval_s": 0}, STREAMS[1]]


def _section(folder: Path, key: FleetKey, **more: Any) -> dict[str, Any]:
    """Write a key file, and return what names it."""
    path = folder / "fleet.key"
    path.unlink(missing_ok=True)
    write_key(path, key)
    security = {"key": str(path), "lives": str(folder / "lives"), **more}
    return {"journal": str(folder / "journal"), "security": security}


def _join(path: Path, address: int = 1) -> None:
    assert main(["key", "rejoin", str(address), "--config", str(path), "--never", "--yes"]) == 0


@asynccontextmanager
async def _gateway(
    address: int, channel: Channel, folder: Path, **section: Any
) -> AsyncIterator[LocalNetwork]:
    """Run a gateway with a journal, and a life of its own where it has a key."""
    found = LocalNetwork(free_port())
    whole = {"address": address, "nodes": NODES, "streams": EAGER, **section}
    config = config_of(address, zenoh_config("router", listen=found.port), whole)
    if config.security is not None:
        from zacoustic.seal.keyring import open_keyring

        lives = open_keyring(config.security, address).lives
        if lives.find().life is None:
            lives.join()
    journal = journal_in(folder / f"journal-{address}", address)
    link = channel.medium.link(address)
    async with Gateway(config, link=link, journal=journal, notify=found.notify):
        yield found


def test_a_sealed_node_in_order_and_what_is_wrong_with_its_files(tmp_path: Path) -> None:
    async def scene() -> None:
        async with modem_file(tmp_path, **_section(tmp_path, KEY)) as path:
            told = await problem(path)
            assert "no record of the lives of node 1" in told.text
            _join(path)
            told = await examine(path)
            assert (told.code, told.findings) == (0, []), told
            (tmp_path / "fleet.key").chmod(0o644)
            told = await problem(path)
            assert "others may read it, mode 0644" in told.text

    run(scene())


def test_a_node_that_only_listens_needs_no_life_and_no_journal(tmp_path: Path) -> None:
    section = _section(tmp_path, KEY, seal="receive")
    del section["journal"]

    async def scene() -> None:
        async with modem_file(tmp_path, **section) as path:
            told = await examine(path)
            assert (told.code, told.findings) == (0, []), told

    run(scene())


def test_frames_that_are_too_short_for_a_seal_or_for_its_pads() -> None:
    def config(**more: Any) -> Config:
        return config_from_mapping({"address": 1, "security": {"key": "k", **more}}, source="file")

    modem = LinkCapabilities(mtu_bytes=64, bit_rate_bps=1000)
    short = LinkCapabilities(mtu_bytes=8, bit_rate_bps=1000)
    without_addresses = LinkCapabilities(mtu_bytes=64, bit_rate_bps=1000, addressed=False)
    assert list(check_room(config(pad=[16, 64]), modem)) == []
    (found,) = check_room(config(), short)
    assert "sealed frames of 8 bytes; allowed: at least 17" in found.what
    (found,) = check_room(config(pad=[32, 64]), without_addresses)
    assert "security.pad: 64; the link has room for sealed frames of 62 bytes" in found.what
    assert list(check_room(config_from_mapping({"address": 1}, source="file"), short)) == []


def test_a_gateway_that_runs_with_another_key_or_none(tmp_path: Path) -> None:
    sealed = _section(tmp_path, KEY)

    async def scene() -> None:
        channel = Channel()
        async with _gateway(1, channel, tmp_path, **sealed) as shore:
            path = beside(tmp_path, shore, streams=EAGER, **sealed)
            told = await examine(path)
            assert (told.code, told.findings) == (0, []), told
            write_key(tmp_path / "fleet.key", KEY.rotated(), replace=True)
            told = await problem(path)
            fingerprint = read_key(tmp_path / "fleet.key").fingerprint
            assert f"has the key {KEY.fingerprint}, generation 0" in told.text
            assert f"the key file has {fingerprint}" in told.text
            told = await problem(beside(tmp_path, shore))
            assert "seals its frames, and this file does not say so" in told.text
        async with _gateway(1, channel, tmp_path) as shore:
            told = await problem(beside(tmp_path, shore, **sealed))
            assert "the running gateway does not seal its frames" in told.text

    run(scene())


STOP = 10


def test_what_a_node_may_not_say_is_not_taken_for_another_key() -> None:
    config = config_from_mapping({"address": 1, "security": {"key": "k"}}, source="file")
    table = StreamTable([TopicSpec(stream_id=STOP, name="auv1/stop")], nodes={3: "buoy"})
    context: Any = SimpleNamespace(engine=SimpleNamespace(table=table))
    events = RecentEvents()
    for refusal, frames in (
        (SealRefusal.FORBIDDEN, 1),
        (SealRefusal.FORBIDDEN, 31),
        (SealRefusal.UNSEALED, 1),
    ):
        event = SealAlarm(
            address=3, refusal=refusal, frames=frames, is_too_many=False,
            stream_id=STOP if refusal is SealRefusal.FORBIDDEN else None,
        )  # fmt: skip
        notice = said(event, context)
        assert notice is not None
        events.note(notice)
    health = {"seal": {"fingerprint": "x"}, **msgspec.to_builtins(events.documents())}
    forbidden, unsealed = check_running(config, health, "x")
    assert forbidden.what.endswith("3 buoy: it sends what it may not send: auv1/stop")
    assert "somebody has its key" in forbidden.why
    assert "has refused frames" in unsealed.what


def test_a_gateway_that_runs_with_an_old_journal(tmp_path: Path) -> None:
    sealed = _section(tmp_path, KEY)

    async def scene() -> None:
        channel, copy = Channel(), tmp_path / "copy"
        for _ in range(2):
            async with _gateway(1, channel, tmp_path, **sealed):
                pass
            if not copy.exists():
                shutil.copytree(tmp_path / "journal-1", copy)
        shutil.rmtree(tmp_path / "journal-1")
        copy.rename(tmp_path / "journal-1")
        async with _gateway(1, channel, tmp_path, **sealed) as shore:
            told = await problem(beside(tmp_path, shore, streams=EAGER, **sealed))
            assert "in doubt: the journal is of life 1, and the last start was life 2" in told.text

    run(scene())


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (None, "its frames are not sealed"),
        (new_key("harbour"), "its frames do not open: another key"),
        (KEY.rotated(), "its frames do not open: another key"),
    ],
    ids=["unsealed", "another key", "another generation"],
)
def test_another_node_without_this_key_is_named(
    other: FleetKey | None, words: str, tmp_path: Path
) -> None:
    (tmp_path / "shore").mkdir()
    (tmp_path / "auv").mkdir()
    here = _section(tmp_path / "shore", KEY)
    there = {} if other is None else _section(tmp_path / "auv", other)

    async def scene() -> None:
        channel = Channel()
        async with (
            _gateway(1, channel, tmp_path, **here) as shore,
            _gateway(2, channel, tmp_path, **there, heartbeat_s=1) as auv,
        ):
            with auv.client() as session:
                publisher = session.declare_publisher("auv1/nav")
                while not any(notice.event == "seal" for notice in shore.notices):
                    sent = channel.sent_by(2)
                    publisher.put(b"here")
                    await until(partial(_has_sent, channel, sent), channel.changed)
            told = await problem(beside(tmp_path, shore, **here))
            assert f"2 auv1: {words}" in told.text

    run(scene())


def _has_sent(channel: Channel, sent: int) -> bool:
    return channel.sent_by(2) > sent
