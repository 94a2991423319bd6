"""No key byte is in any log, recording, journal, health document, report or error of a run."""

import asyncio
import base64
import contextlib
import io
import json
import logging
import os
import random
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import zenoh

from tests.gateway.networks import (
    SECTION,
    Channel,
    config_of,
    free_port,
    get,
    hear,
    run,
    until,
    zenoh_config,
    zenoh_settings,
)
from tests.secretbytes import forms_of, found_in
from zacoustic.app.cli import main
from zacoustic.gateway import Gateway, Notice
from zacoustic.seal.keyring import open_keyring
from zacoustic.seal.keys import new_key, write_key


def test_what_the_search_finds(tmp_path: Path) -> None:
    rng = random.Random(5)
    secret = rng.randbytes(32)
    around = [rng.randbytes(each) for each in range(3)]
    planted = [
        secret, secret[8:16], secret.hex().encode(), secret.hex(" ").upper().encode(),
        repr(secret).encode(), str(list(secret)).encode(), base64.urlsafe_b64encode(secret),
        *(base64.b64encode(before + secret + b"behind") for before in around),
        json.dumps({"secret": base64.b64encode(secret).decode()}).encode(),
    ]  # fmt: skip
    for number, content in enumerate(planted):
        path = tmp_path / f"{number}"
        path.write_bytes(b"before " + content + b" behind")
        assert found_in(tmp_path, [secret]) == [str(path)], content
        assert found_in(tmp_path, [secret], apart_from=[path]) == []
        assert found_in(tmp_path, [rng.randbytes(32)]) == []
        path.unlink()
    assert min(map(len, forms_of(secret))) >= 8


@contextlib.contextmanager
def _log_into(path: Path) -> Iterator[None]:
    """Log everything, of everybody."""
    root, handler = logging.getLogger(), logging.FileHandler(path)
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        root.setLevel(level)
        root.removeHandler(handler)
        handler.close()


def test_a_run_writes_no_byte_of_a_key(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    former = new_key("harbour")
    key, folder = former.rotated(), tmp_path / "written"
    key_file, spoilt = tmp_path / "fleet.key", tmp_path / "spoilt.key"
    write_key(key_file, key)
    spoilt.write_bytes(key_file.read_bytes()[:-9])
    spoilt.chmod(0o600)
    folder.mkdir()
    security = {"key": str(key_file)}
    section = SECTION | {"security": security, "permit_log": str(folder / "permit.jsonl")}
    port = free_port()

    async def scene() -> None:
        channel, notices = Channel(), (folder / "notices").open("w")
        changed = asyncio.Event()

        def note(notice: Notice) -> None:
            notices.write(f"{notice!r} {notice.lines()}\n")
            changed.set()

        async with contextlib.AsyncExitStack() as stack:
            for address, settings in (
                (1, zenoh_config("router", listen=port)),
                (2, zenoh_config("router", listen=free_port())),
            ):
                lives = {"lives": str(folder / f"lives-{address}")}
                config = config_of(address, settings, section | {"security": security | lives})
                assert config.security is not None
                open_keyring(config.security, address).lives.join()
                gateway = Gateway(
                    config,
                    link=channel.medium.link(address),
                    journal=folder / f"journal-{address}",
                    record=folder / f"{address}.mcap",
                    notify=note,
                )
                await stack.enter_async_context(gateway)
            with zenoh_client(port) as session:
                heard = await hear(session, "@acoustic/**")
                session.put("auv1/text", b"hello")
                await until(partial(channel.sent_by, 1), channel.changed)
                silence = "@acoustic/2/silence?command=begin;for_s=5"
                (folder / "answer").write_text(repr((await get(session, silence)).good))
                documents = await get(session, "@acoustic/1/*")
                assert "@acoustic/1/seal" in documents.good
                text = b"\n".join(each.payload.to_bytes() for each in documents.good.values())
                text += b"\n".join(each.payload.to_bytes() for each in heard.samples)
                (folder / "health").write_bytes(text)
                await _doctor(folder, section, port)
        notices.close()

    with _log_into(folder / "log"), caplog.at_level(logging.DEBUG):
        run(scene())
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            for verb in (
                ("key", "show", str(key_file)), ("key", "show", str(spoilt)),
                ("key", "rotate", str(spoilt)), ("key", "revoke", str(key_file), "2"),
                ("-v", "report", str(folder / "1.mcap")), ("decode", str(folder / "2.mcap")),
                ("journal", "check", str(folder / "journal-1" / "node-1.sqlite"), "--json"),
            ):  # fmt: skip
                main(list(verb))
            key_file.chmod(0o644)
            main(["key", "show", str(key_file)])
        (folder / "said").write_text(said.getvalue())
    assert "fingerprint" in said.getvalue()
    assert key.former is not None
    secrets = [key.secret, key.former]
    for address in (1, 2):
        for is_former in (False, True):
            node_key = key.node_key(address, former=is_former)
            assert node_key is not None
            secrets.append(node_key)
    assert key.fingerprint.encode() in (folder / "health").read_bytes()
    assert os.path.getsize(folder / "log") > 0
    assert found_in(tmp_path, secrets, apart_from=[key_file, spoilt]) == []
    assert set(found_in(tmp_path, secrets)) == {str(key_file), str(spoilt)}


@contextlib.contextmanager
def zenoh_client(port: int) -> Iterator[zenoh.Session]:
    with zenoh.open(zenoh_config("client", connect=port)) as session:
        yield session


async def _doctor(folder: Path, section: dict[str, object], port: int) -> None:
    """Have the doctor look at node 1, and keep what it says."""
    whole = json.loads(zenoh_settings("router", listen=port))
    path = folder / "router.json5"
    path.write_text(json.dumps(whole | {"plugins": {"acoustic": section}}))
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        await asyncio.to_thread(main, ["doctor", str(path), "--json"])
        await asyncio.to_thread(main, ["check", str(path)])
        await asyncio.to_thread(main, ["key", "check", str(path)])
    (folder / "doctor").write_text(said.getvalue())
