"""Named losses: frames that are lost at any level, one by one or in bursts.

The chain of Gilbert and Elliott has a good state, in which every frame passes, and a bad one, in
which every frame is lost. It moves once per frame: from good to bad with probability p, back with
r. The share of lost frames is p / (p + r), the mean run of lost frames 1 / r, and the correlation
of consecutive frames 1 − p − r. For a share L and a run b: r = 1/b, p = r L / (1 − L). Without a
burst length losses are independent, which is the chain with p + r = 1.

Source:
    E. N. Gilbert, Bell Syst. Tech. J. 39 (1960) 1253; E. O. Elliott, Bell Syst. Tech. J. 42 (1963)
    1977.
"""

import random

import msgspec

from zacoustic.channel.faults.limits import check_range


class LossSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Frames that are lost at any level."""

    frame: float = 0.0
    """Share of lost frames, 0…1."""
    burst_frames: float | None = None
    """Mean length of a run of lost frames, ≥ 1; None: losses are independent."""
    until_s: float | None = None
    """No frame is lost after this instant, s; None: no limit."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A share outside 0…1, or a burst that this share does not allow.
        """
        check_range("frame", self.frame, 0.0, 1.0)
        if self.until_s is not None:
            check_range("until_s", self.until_s, 0.0, 1.0e9)
        if self.burst_frames is None:
            return
        check_range("burst_frames", self.burst_frames, 1.0, 1.0e6)
        shortest = self.frame / (1.0 - self.frame) if self.frame < 1.0 else float("inf")
        if self.burst_frames < shortest:
            raise ValueError(
                f"burst_frames is {self.burst_frames!r}; "
                f"allowed: at least frame / (1 − frame), which is {shortest:g}"
            )


class FrameLoss:
    """Decides for each frame of one sender, in order, whether it is lost.

    Args:
        spec: Share and burst length.
        rng: Generator of this direction; each frame draws one number.
    """

    def __init__(self, spec: LossSpec, rng: random.Random) -> None:
        self._rng = rng
        self._until = None if spec.until_s is None else round(spec.until_s * 1e9)
        if spec.burst_frames is None:
            self.to_bad = spec.frame
            self.to_good = 1.0 - spec.frame
        else:
            self.to_good = 1.0 / spec.burst_frames
            self.to_bad = self.to_good * spec.frame / (1.0 - spec.frame)
        # The first frame meets the stationary chain: the state before it is good or bad in that
        # proportion.
        self._bad = rng.random() < spec.frame

    def next_is_lost(self, now: int) -> bool:
        """Advance by one frame, which leaves at an instant, ns; return whether it is lost."""
        draw = self._rng.random()
        self._bad = draw >= self.to_good if self._bad else draw < self.to_bad
        return self._bad and (self._until is None or now < self._until)
