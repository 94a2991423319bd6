"""The water around the vehicle: its current and its bed."""

import math
from typing import Final

import msgspec


class World(msgspec.Struct, frozen=True, kw_only=True):
    """One place at sea; the same current everywhere."""

    current_m_s: tuple[float, float] = (0.0, 0.0)
    """To the north, to the east."""
    bed_m: float = 80.0
    """Mean depth of the bed."""
    relief_m: float = 6.0
    """How far its hills rise above that, and its valleys fall below."""

    def bed_depth_m(self, north_m: float, east_m: float) -> float:
        """Return the depth of the bed below a place, m: hills some 200 m apart."""
        hills = math.sin(north_m / 31.0) + math.cos(east_m / 43.0 + north_m / 97.0)
        return self.bed_m + self.relief_m * hills / 2


STILL: Final = World(relief_m=0.0)
"""No current, a flat bed."""
TRIAL: Final = World(current_m_s=(0.08, -0.05))
"""Where the dive of this example takes place."""
