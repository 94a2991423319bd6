"""A gateway with a journal: what it says of it, at the start and while it cannot be written."""

import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.gateway.networks import (
    Channel,
    LocalNetwork,
    config_of,
    free_port,
    get,
    run,
    zenoh_config,
)
from zacoustic.core.base.journal import JournalWrite
from zacoustic.errors import ConfigError
from zacoustic.gateway import Gateway, Notice
from zacoustic.run.journal import Journal, JournalState, SqliteJournal, journal_in


def gateway(
    found: LocalNetwork,
    channel: Channel,
    journal: Journal | Path | None,
    *,
    configured: Path | None = None,
) -> Gateway:
    config = config_of(2, zenoh_config("router", listen=found.port))
    config = msgspec.structs.replace(config, journal=configured)
    return Gateway(config, link=channel.medium.link(2), journal=journal, notify=found.notify)


def started(found: LocalNetwork) -> Notice:
    return found.told("started")[0]


async def health(found: LocalNetwork, document: str = "journal") -> dict[str, Any]:
    with found.client() as client:
        replies = await get(client, f"@acoustic/2/{document}")
    answer: dict[str, Any] = json.loads(replies.payload(f"@acoustic/2/{document}"))
    return answer


@pytest.mark.parametrize("given", ["argument", "configuration"])
def test_gateway_keeps_its_journal_in_the_folder_and_says_where(tmp_path: Path, given: str) -> None:
    async def main() -> None:
        for _ in range(2):
            found, channel = LocalNetwork(free_port()), Channel()
            in_config = tmp_path if given == "configuration" else None
            argument = tmp_path if given == "argument" else None
            async with gateway(found, channel, argument, configured=in_config):
                assert started(found).facts["journal"] == str(tmp_path / "node-2.sqlite")
                assert started(found).facts["forgotten"] == ""
                assert f"journal   {tmp_path / 'node-2.sqlite'}" in started(found).lines()
                assert await health(found) == {"kept": True, "failure": "", "doubt": ""}
                second = gateway(LocalNetwork(free_port()), Channel(), tmp_path)
                with pytest.raises(ConfigError, match="in use by another node or process"):
                    await second.start()

    run(main())
    journal = journal_in(tmp_path, 2)
    before = sqlite3.connect(journal.path)
    rows = dict(before.execute("SELECT key, value FROM entry"))
    before.close()
    assert journal.recover().boot_epoch % 64 == (int.from_bytes(rows["epoch"], "big") + 1) % 64
    journal.close()


def test_gateway_without_a_journal_says_what_a_restart_forgets() -> None:
    async def main() -> None:
        found, channel = LocalNetwork(free_port()), Channel()
        async with gateway(found, channel, None):
            assert started(found).facts["journal"] == ""
            assert (
                started(found)
                .facts["forgotten"]
                .startswith("no journal, so a restart forgets calls of")
            )
            assert any("restart forgets" in line for line in started(found).lines())
            assert await health(found) == {"kept": False, "failure": "", "doubt": ""}

    run(main())


def test_gateway_goes_on_while_its_journal_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zacoustic.run.journal.thread.FIRST_RETRY_S", 0.001)

    class Failing(SqliteJournal):
        failures = 1_000_000

        def commit(self, writes: Sequence[JournalWrite]) -> None:
            if self.failures > 0:
                self.failures -= 1
                raise OSError("the disk is full")
            super().commit(writes)

    async def main() -> None:
        found, channel = LocalNetwork(free_port()), Channel()
        journal = Failing(tmp_path / "node-2.sqlite", 2)

        async def changed(failure: str) -> None:
            while failure not in [each.facts["failure"] for each in found.told("journal")]:
                found.changed.clear()
                await found.changed.wait()

        async with gateway(found, channel, journal):
            await changed("the disk is full")
            assert await health(found) == {"kept": True, "failure": "the disk is full", "doubt": ""}
            journal.failures = 0
            await changed("")
            assert await health(found) == {"kept": True, "failure": "", "doubt": ""}
        lines = [line for notice in found.notices for line in notice.lines()]
        assert "journal   fails, what is reliable waits: the disk is full" in lines
        assert "journal   can be written again" in lines

    run(main())


def test_damaged_journal_does_not_stop_a_gateway_which_says_so_in_its_health(
    tmp_path: Path,
) -> None:
    (tmp_path / "node-2.sqlite").write_bytes(b"rust")

    async def main() -> None:
        found, channel = LocalNetwork(free_port()), Channel()
        async with gateway(found, channel, tmp_path):
            doubt = (await health(found))["doubt"]
            assert "node-2.sqlite: it is damaged" in doubt
            assert (await health(found, "node"))["doubt"] == doubt
            assert [each.facts["reason"] for each in found.told("journal_in_doubt")] == [doubt]

    run(main())


def test_journal_is_released_when_the_gateway_does_not_start(tmp_path: Path) -> None:
    class Closing(SqliteJournal):
        open = 0

        def recover(self) -> JournalState:
            self.open += 1
            return super().recover()

        def close(self) -> None:
            self.open = 0
            super().close()

    async def main() -> None:
        port, channel = free_port(), Channel()
        async with gateway(LocalNetwork(port), channel, None):
            journal = Closing(tmp_path / "node-2.sqlite", 2)
            with pytest.raises(Exception, match="in use"):
                await gateway(LocalNetwork(port), Channel(), journal).start()
            assert journal.open == 0
        anew = journal_in(tmp_path, 2)
        anew.recover()
        anew.close()

    run(main())
