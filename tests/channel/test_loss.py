import random
from itertools import groupby, pairwise

import pytest

from zacoustic.channel.faults.loss import FrameLoss, LossSpec


def _lost(spec: LossSpec, count: int, seed: int = 1) -> list[bool]:
    process = FrameLoss(spec, random.Random(seed))
    return [process.next_is_lost(0) for _ in range(count)]


@pytest.mark.parametrize(
    ("share", "burst", "to_bad"),
    [
        (0.1, 2, 0.055556),
        (0.1, 5, 0.022222),
        (0.3, 3, 0.142857),
        (0.3, 10, 0.042857),
        (0.5, 4, 0.25),
    ],
)
def test_bursts_have_the_share_the_length_and_the_chain_of_the_reference(
    share: float, burst: float, to_bad: float
) -> None:
    spec = LossSpec(frame=share, burst_frames=burst)
    assert FrameLoss(spec, random.Random(1)).to_bad == pytest.approx(to_bad, abs=6e-7)
    lost = _lost(spec, 100_000)
    runs = [len(list(group)) for is_lost, group in groupby(lost) if is_lost]
    assert sum(lost) / len(lost) == pytest.approx(share, abs=0.012)
    assert sum(runs) / len(runs) == pytest.approx(burst, rel=0.05)


def test_single_losses_have_no_memory() -> None:
    lost = _lost(LossSpec(frame=0.2), 50_000)
    assert sum(lost) / len(lost) == pytest.approx(0.2, abs=0.006)
    after_a_loss = [b for a, b in pairwise(lost) if a]
    assert sum(after_a_loss) / len(after_a_loss) == pytest.approx(0.2, abs=0.015)


@pytest.mark.parametrize(("share", "expected"), [(0.0, False), (1.0, True)])
def test_extreme_shares_lose_nothing_or_all(share: float, expected: bool) -> None:
    assert set(_lost(LossSpec(frame=share), 1000)) == {expected}


def test_the_first_frame_of_a_bursty_link_is_as_likely_lost_as_any() -> None:
    spec = LossSpec(frame=0.3, burst_frames=20)
    first = [_lost(spec, 1, seed)[0] for seed in range(4000)]
    assert sum(first) / len(first) == pytest.approx(0.3, abs=0.025)


@pytest.mark.parametrize(
    ("share", "burst", "message"),
    [
        (-0.1, None, "frame is -0.1; allowed: 0..1"),
        (1.1, None, "frame is 1.1; allowed: 0..1"),
        (float("nan"), None, "frame is nan; allowed: 0..1"),
        (0.1, 0.5, "burst_frames is 0.5; allowed: 1.."),
        (0.9, 4.0, "burst_frames is 4.0; allowed: at least frame / .* which is 9"),
        (1.0, 4.0, "burst_frames is 4.0; allowed: at least frame / .* which is inf"),
    ],
)
def test_impossible_losses_are_refused(share: float, burst: float | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LossSpec(frame=share, burst_frames=burst)
