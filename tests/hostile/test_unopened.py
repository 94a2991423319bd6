"""Frames that no key of the fleet has made, at a sealed node: nothing opens, nothing follows."""

import random
from collections.abc import Callable
from typing import Final

import pytest

from tests.hostile.unopened import Victim, changed_frames, random_frames

FRAMES: Final = 1 << 20


@pytest.mark.parametrize("strong", [False, True])
def test_no_random_frame_is_opened_and_none_has_an_effect(
    strong: bool, count: Callable[[int], int]
) -> None:
    victim = Victim()
    victim.hear(random_frames(victim.sent, random.Random(5), strong=strong), count(FRAMES))


@pytest.mark.parametrize("strong", [False, True])
def test_no_changed_frame_is_opened_and_none_has_an_effect(
    strong: bool, count: Callable[[int], int]
) -> None:
    victim = Victim()
    victim.hear(changed_frames(victim.sent, random.Random(6), strong=strong), count(FRAMES))


def test_whoever_was_heard_in_a_sealed_frame_is_told_at_once() -> None:
    """Not with the next frame: that of a stranger, an hour later."""
    assert Victim().peers_seen >= 1
