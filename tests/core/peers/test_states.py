"""The states of a peer: what the wire page prints is what the code does."""

import itertools
from enum import Enum
from pathlib import Path
from typing import Any

import pytest

from zacoustic.core.peers.peer import Peer
from zacoustic.core.peers.states import (
    AGREEMENT,
    LIFE,
    REACHABILITY,
    Agreement,
    Change,
    Life,
    Transitions,
)

PAGE = Path(__file__).parents[3] / "docs" / "wire.md"
TABLES: dict[str, Transitions[Any]] = {
    "Agreement": AGREEMENT,
    "Life": LIFE,
    "Reachability": REACHABILITY,
}


@pytest.mark.parametrize("name", TABLES)
def test_the_page_prints_the_table_of_the_code(name: str) -> None:
    table: Transitions[Any] = TABLES[name]
    section = PAGE.read_text(encoding="utf-8").split(f"\n{name}: ")[1]
    assert f"begins as\n`{table.first.value}`" in section or (
        f"begins as `{table.first.value}`" in section
    )
    lines = list(itertools.takewhile(str.strip, section.split("\n\n", 1)[1].splitlines()))
    rows = [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines[2:]]
    assert rows == table.rows()


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_every_state_is_reached_and_left(table: Transitions[Any]) -> None:
    kind: type[Enum] = type(table.first)
    states = list(kind)
    reached = {table.first}
    for _ in states:
        reached |= {table.after(state, change) for state in reached for change in Change}
    assert reached == set(states)
    assert all(any(table.after(state, change) != state for change in Change) for state in states)


def test_only_a_confirmation_that_holds_confirms() -> None:
    confirmed = {
        (state, change)
        for state in Agreement
        for change in Change
        if state is not Agreement.CONFIRMED
        and AGREEMENT.after(state, change) is Agreement.CONFIRMED
    }
    assert {change for _, change in confirmed} == {Change.CONFIRM, Change.HELD}
    assert (Agreement.UNCONFIRMED, Change.HELD) not in confirmed


def test_life_of_a_peer_follows_its_table() -> None:
    peer = Peer()
    assert peer.life(0) is Life.UNKNOWN is LIFE.first
    peer.begin_life(Change.NEW_LIFE)
    peer.epoch, peer.settled_at = 7, 100
    assert peer.life(99) is LIFE.after(Life.UNKNOWN, Change.NEW_LIFE)
    assert peer.life(100) is LIFE.after(Life.SETTLING, Change.SETTLED)
    peer.begin_life(Change.STRAY_TAG)
    peer.epoch = None
    assert peer.life(200) is LIFE.after(Life.SETTLED, Change.STRAY_TAG)


def test_provisional_agreement_holds_when_its_time_has_come() -> None:
    peer = Peer()
    peer.take(Change.EARLY_CONFIRM)
    peer.holds_at = 50
    peer.ripen(49)
    assert (peer.agreement, peer.knows_us) == (Agreement.PROVISIONAL, False)
    peer.ripen(50)
    assert (peer.agreement, peer.knows_us) == (Agreement.CONFIRMED, True)
    peer.take(Change.DOUBT)
    assert (peer.agreement, peer.knows_us) == (Agreement.UNCONFIRMED, True)
