"""How often each topic crosses, so that all of them together leave room on the channel.

A topic keeps the period at which it was published, if that is slow enough. The others get a common
least interval, shorter for urgent ones and longer for those in the background, and it grows until
the airtime of all topics, each in frames of its own, is within the budget. What is larger than a
frame has a part of the budget of its own: a device that publishes a kilobyte five times a second
would leave nothing to its neighbours.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.crossing import room_bytes
from zacoustic.app.tools.design.first.drafting import TopicDraft
from zacoustic.channel.profiles import ModemProfile

BUDGET: Final = 0.3
"""Share of the time that all topics together may take."""
LARGE_BUDGET: Final = 0.15
"""Share of the time that all topics larger than a frame may take of it."""
INTERVAL_S: Final = 5.0
"""Least interval of a usual topic, s: a channel carries one or two frames per second in all."""
LIFESPAN_S: Final = 60.0
"""Largest age of a sample, s, unless it takes longer to cross."""
LONGEST_S: Final = 3600.0
"""Longest interval that is proposed, s."""

_WEIGHTS: Final = {"real_time": 0.2, "interactive_high": 0.4, "data_low": 2.0, "background": 4.0}
_MEASURED: Final = 1.001
"""A period is measured that exactly."""
_HEAD_BYTES: Final = 8  # id, number, SYNC and the like
_PARTS_MARGIN: Final = 3
_FRAGMENT_HEAD_BYTES: Final = 12
_REPAIR: Final = 1.2
_MOST_TURNS: Final = 60


def sized(draft: TopicDraft, payload_bytes: int, profile: ModemProfile) -> TopicDraft:
    """Determine whether the largest sample fits a frame, and how long it takes if it does not."""
    if 1 + payload_bytes <= room_bytes(profile.mtu_bytes):
        return draft
    frames = 1 + payload_bytes // (profile.mtu_bytes // 2)  # with headers, answers and repair
    frame_s = profile.airtime_s(profile.mtu_bytes) + profile.gap_s
    parts_s = math.ceil(_PARTS_MARGIN * frames * frame_s / INTERVAL_S) * INTERVAL_S
    return msgspec.structs.replace(draft, parts_s=max(LIFESPAN_S, parts_s))


def paced(
    drafts: Sequence[TopicDraft], sizes: Sequence[int], profile: ModemProfile
) -> list[TopicDraft]:
    """Give each topic its interval.

    Args:
        drafts: The topics.
        sizes: Largest payload of each, bytes.
        profile: The modem.
    """
    costs = [_cost_s(draft, size, profile) for draft, size in zip(drafts, sizes, strict=True)]
    large = [index for index, draft in enumerate(drafts) if draft.parts_s is not None]
    small = [index for index, draft in enumerate(drafts) if draft.parts_s is None]
    intervals: dict[int, float | None] = {}
    left = BUDGET
    for group, budget in ((large, LARGE_BUDGET), (small, BUDGET)):
        found = _within([(drafts[index], costs[index]) for index in group], min(budget, left))
        intervals |= dict(zip(group, found, strict=True))
        spent = zip((costs[index] for index in group), found, strict=True)
        left = max(BUDGET - LARGE_BUDGET, BUDGET - _load(spent))
    return [
        msgspec.structs.replace(draft, interval_s=intervals[index])
        for index, draft in enumerate(drafts)
    ]


def _within(priced: Sequence[tuple[TopicDraft, float]], budget: float) -> list[float | None]:
    """Return the shortest intervals with which topics stay within a share of the time."""
    intervals: list[float | None] = []
    stretch = 1.0
    for _ in range(_MOST_TURNS):
        intervals = [_interval_s(draft, cost_s, stretch) for draft, cost_s in priced]
        costs = (cost_s for _, cost_s in priced)
        if _load(zip(costs, intervals, strict=True)) <= budget:
            break
        stretch *= 1.15
    return intervals


def _load(priced: Iterable[tuple[float, float | None]]) -> float:
    """Return the share of the time that samples of some cost take at their intervals."""
    return sum(cost_s / interval_s for cost_s, interval_s in priced if interval_s)


def _cost_s(draft: TopicDraft, size_bytes: int, profile: ModemProfile) -> float:
    """Return the airtime of a sample, with the answer to a reliable one, s."""
    if draft.parts_s is not None:
        frames = math.ceil(size_bytes / (profile.mtu_bytes - _FRAGMENT_HEAD_BYTES))
        return _REPAIR * (frames + 1) * profile.airtime_s(profile.mtu_bytes)
    frame_s = profile.airtime_s(min(profile.mtu_bytes, size_bytes + _HEAD_BYTES))
    answer_s = profile.airtime_s(_HEAD_BYTES) if draft.is_reliable else 0.0
    return frame_s + answer_s


def _interval_s(draft: TopicDraft, cost_s: float, stretch: float) -> float | None:
    """Return the least time between two samples, s; None: it was published once or never."""
    seen = draft.seen
    period_s = seen.period_s
    if period_s is None:
        # A rate of a single sample is that of the listening; of something large it still counts.
        period_s = 1 / seen.rate_hz if seen.samples > 1 and seen.rate_hz > 0 else None
    if period_s is None and (draft.parts_s is None or not seen.samples):
        return None
    if draft.parts_s is not None and period_s is None:
        return _near(draft.parts_s) if seen.samples else None
    usual_s = INTERVAL_S if draft.parts_s is None else cost_s / LARGE_BUDGET
    least_s = usual_s * _WEIGHTS.get(draft.priority, 1.0) * stretch
    return min(LONGEST_S, max(_rounded(least_s), _near(period_s or 0.0)))


def _near(period_s: float) -> float:
    """Return a measured period in two digits, not above: no sample waits for the end of it.

    An interval that is a little longer than the period delays each sample more than the one before.
    """
    if period_s <= 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(period_s)) - 1)
    return float(f"{math.floor(period_s * _MEASURED / unit) * unit:.6g}")


def _rounded(seconds: float) -> float:
    """Return the next interval with two digits that is not below."""
    unit = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return float(f"{math.ceil(seconds / unit - 1e-9) * unit:.6g}")
