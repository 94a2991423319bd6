"""The recorded channel of one direction: which part of the recording each frame meets."""

import math
import random
from itertools import accumulate
from typing import Final

from zacoustic.channel.formulae.modulation import ratio
from zacoustic.channel.recorded import RecordedSpec

_NS_PER_S: Final = 1_000_000_000
_LEAST: Final = 1e-10  # −100 dB


class RecordedFades:
    """The fades and echoes of one sender's frames on their way to one node.

    Args:
        recorded: The recording.
        rng: Draws at which response this direction begins, once.
    """

    def __init__(self, recorded: RecordedSpec, rng: random.Random) -> None:
        self._count = len(recorded.gains_db)
        self._first = int(rng.random() * self._count)
        self._per_ns = 1.0 / (recorded.every_s * _NS_PER_S)
        self._all = (0.0, *accumulate(map(ratio, recorded.gains_db)))
        self._used = (0.0, *accumulate(map(ratio, recorded.used_db)))

    def over(self, now: int, airtime_ns: int) -> tuple[float, float, float]:
        """Return the mean channel of a frame.

        Args:
            now: Instant of its start, ns.
            airtime_ns: Its duration, ns.

        Returns:
            Its gain over the mean, dB; that of the part that the receiver uses, dB; and that part
            over the rest, dB.
        """
        begin = self._first + int(now * self._per_ns)
        end = max(begin + 1, self._first + int((now + airtime_ns) * self._per_ns))
        power, used = (self._mean(sums, begin, end) for sums in (self._all, self._used))
        echoes = max(power - used, used * _LEAST)
        return _db(power), _db(used), _db(used / echoes)

    def _mean(self, sums: tuple[float, ...], begin: int, end: int) -> float:
        def until(response: int) -> float:
            rounds, rest = divmod(response, self._count)
            return rounds * sums[-1] + sums[rest]

        first = begin - begin % self._count  # small numbers lose fewer digits
        return max(_LEAST, (until(end - first) - until(begin - first)) / (end - begin))


def _db(power: float) -> float:
    return 10.0 * math.log10(power)
