"""A node with a journal: what its next life knows, and who may use the file."""

import json
from pathlib import Path

import pytest

from tests.node.fleet import SECTION, channel, config
from tests.runtime.loop_checks import run
from zacoustic import ConfigError, DeliveryOutcome, Node
from zacoustic.config import config_from_mapping
from zacoustic.core.engine.events import PeerSeen
from zacoustic.run.journal import Journal, MemoryJournal, SqliteJournal
from zacoustic_sim.medium import SimMedium


async def epoch_seen(medium: SimMedium, node: Node) -> int:
    """The epoch of a node, as another one hears it."""
    async with Node(1, config=config(), link=medium.link(1)) as shore, node:
        node.create_publisher(bytes, "note").publish(b"here")
        async for event in shore.events():
            if isinstance(event, PeerSeen):
                return event.epoch
    raise AssertionError("the events have ended")


@pytest.mark.parametrize("given", ["folder", "store", "configuration"])
def test_each_life_of_a_node_has_another_epoch(tmp_path: Path, given: str) -> None:
    file = tmp_path / "fleet.json5"
    section = {**SECTION, "journal": "state"} if given == "configuration" else SECTION
    file.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    path = tmp_path / "state" / "node-2.sqlite"

    def node(medium: SimMedium) -> Node:
        journals: dict[str, Journal | Path | None] = {
            "folder": path.parent,
            "store": SqliteJournal(path, 2),
            "configuration": None,
        }
        return Node(2, config=file, link=medium.link(2), journal=journals[given])

    async def main() -> None:
        epochs = []
        for _ in range(3):
            with channel() as medium:
                epochs.append(await epoch_seen(medium, node(medium)))
        assert [epoch % 64 for epoch in epochs] == [(epochs[0] + more) % 64 for more in range(3)]

    run(main())
    assert path.is_file()
    assert not path.with_name("node-2.sqlite-wal").exists(), "closed"


class Kept(MemoryJournal):
    """A journal that shows what the last commit left."""

    @property
    def keys(self) -> set[str]:
        return {*self._entries}


def test_an_end_that_was_told_is_not_told_by_the_next_life() -> None:
    journal = Kept()
    log = {"id": 90, "topic": "log", "publishers": [2], "subscribers": [1]}
    log |= {"reliability": "reliable", "depth": 8, "journal": True}
    section = {**SECTION, "streams": [log]}

    def node(address: int, medium: SimMedium) -> Node:
        fleet = config_from_mapping(section, source="fleet.json5", address=address)
        kept = journal if address == 2 else None
        return Node(address, config=fleet, link=medium.link(address), journal=kept)

    async def main() -> None:
        with channel() as medium:
            async with node(1, medium), node(2, medium) as auv:
                delivery = auv.create_publisher(bytes, "log").publish(b"once")
                assert delivery is not None
                assert await delivery is DeliveryOutcome.DELIVERED
        assert not [key for key in journal.keys if key.startswith("outcome/")]
        assert [key for key in journal.keys if key.startswith("out/")], "its count stays"

    run(main())


def test_second_node_on_a_journal_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node(2, config=config(), link=medium.link(2), journal=tmp_path) as node:
                second = Node(2, config=config(), link=medium.link(3), journal=str(tmp_path))
                with pytest.raises(ConfigError, match="in use by another node or process"):
                    await second.open()
                node.create_publisher(bytes, "note").publish(b"still here")
                await node.flush()

    run(main())


def test_journal_without_a_link_is_refused(tmp_path: Path) -> None:
    async def main() -> None:
        with pytest.raises(ConfigError, match="journal is given without link"):
            await Node("auv1", connect="tcp/127.0.0.1:1", journal=tmp_path).open()

    run(main())
    assert list(tmp_path.iterdir()) == []
