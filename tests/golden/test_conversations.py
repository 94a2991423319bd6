"""Conversations: the engines still hold them, and each end understands the other's frames."""

import json

import pytest

from tests.golden.conversation import SEED, Conversation, Line, Scene, record, replay
from tests.golden.scenes import FOLDER, SCENES, path_of, read, text
from tests.golden.tables import TABLES

BOTH = [pytest.param(scene, node, id=f"{scene.name}-{node}") for scene in SCENES for node in (1, 2)]
BY_NAME = [pytest.param(scene, id=scene.name) for scene in SCENES]
OTHER_SEED = 2


@pytest.mark.parametrize("scene", BY_NAME)
def test_conversation_is_held_as_it_was(scene: Scene) -> None:
    assert path_of(scene).read_text(encoding="utf-8") == text(record(scene))


def test_every_file_is_of_a_scene() -> None:
    assert {path.name for path in FOLDER.iterdir()} == {path_of(each).name for each in SCENES}


@pytest.mark.parametrize(("scene", "node"), BOTH)
def test_a_fresh_engine_answers_the_frames_of_the_other_end_in_the_same_way(
    scene: Scene, node: int
) -> None:
    conversation = read(scene)
    expected = [each for each in at(conversation, node) if not each.loses]
    assert replay(scene, conversation, node) == expected


@pytest.mark.parametrize(("scene", "node"), BOTH)
def test_an_engine_with_other_random_numbers_delivers_the_same(scene: Scene, node: int) -> None:
    """So an implementation that waits otherwise has to deliver it, too."""
    conversation = read(scene)
    lines = replay(scene, conversation, node, seed=OTHER_SEED)
    assert [each.receives for each in lines if each.receives] == [
        each.receives for each in at(conversation, node) if each.receives
    ]


@pytest.mark.parametrize("scene", BY_NAME)
def test_what_the_scene_loses_is_lost(scene: Scene) -> None:
    lost = [each.loses for each in read(scene).lines if each.loses]
    assert sorted(lost) == sorted(f"{source}.{number}" for source, number in scene.lost)


@pytest.mark.parametrize("scene", BY_NAME)
def test_instants_follow_from_the_link(scene: Scene) -> None:
    """Written from docs/wire.md alone: airtime of the frame, then the propagation delay."""
    conversation = json.loads(path_of(scene).read_text(encoding="utf-8"))
    link = conversation["link"]
    ended: dict[str, int] = {}
    sizes: dict[str, int] = {}
    for line in conversation["lines"]:
        if "sends" in line:
            sizes[line["sends"]] = len(line["hex"]) // 2
        if "sent" in line:
            ended[line["sent"]] = line["at_ns"]
        if "hears" in line:
            name = line["hears"]
            assert line["at_ns"] - ended[name] == pytest.approx(link["propagation_s"] * 1e9)
            assert 1 <= sizes[name] <= link["mtu_bytes"]


def test_the_tables_are_those_of_the_file() -> None:
    for scene in SCENES:
        assert set(scene.tables.values()) <= set(TABLES)
    assert SEED != OTHER_SEED


def at(conversation: Conversation, node: int) -> list[Line]:
    """Return the lines of one node."""
    return [each for each in conversation.lines if each.node == node]
