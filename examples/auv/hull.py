"""The body: masses, boxes and where they are, as in the simulation of the paper.

Axes are Fossen's: x forward, y to starboard, z down, origin at the middle of the hull. The model of
the paper is drawn the other way round (it faces -x, z up); lengths are the same.
"""

from typing import Final

import msgspec

WATER_DENSITY_KG_M3: Final = 1000.0
GRAVITY_M_S2: Final = 9.8


class Part(msgspec.Struct, frozen=True):
    """One link of the model."""

    mass_kg: float
    x_m: float
    """Place of its centre along the hull, m; behind the middle is negative."""
    box_m: tuple[float, float, float]
    """A part that displaces water: length, width, height."""

    @property
    def volume_m3(self) -> float:
        """Displaced water, m³."""
        length, width, height = self.box_m
        return length * width * height


BASE: Final = Part(147.8671, 0.0, (2.0, 0.3, 0.2464451666666667))
VERTICAL_FINS: Final = Part(0.2, -1.05, (0.1, 0.1, 0.02))
HORIZONTAL_FINS: Final = Part(0.2, -1.05, (0.1, 0.1, 0.02))
PROPELLER: Final = Part(0.09, -1.43162, (0.03, 0.1, 0.03))
PARTS: Final = (BASE, VERTICAL_FINS, HORIZONTAL_FINS, PROPELLER)

MASS_KG: Final = sum(part.mass_kg for part in PARTS)
VOLUME_M3: Final = sum(part.volume_m3 for part in PARTS)
CENTRE_X_M: Final = sum(part.mass_kg * part.x_m for part in PARTS) / MASS_KG
"""Centre of mass along the hull, m. The parts are as dense as water: that of buoyancy as well."""
HEIGHT_M: Final = BASE.box_m[2]

# The inertia of the base is given; of the parts behind, only their distance matters.
INERTIA_X_KG_M2: Final = 3.0
INERTIA_YZ_KG_M2: Final = 41.980233 + sum(
    part.mass_kg * part.x_m * part.x_m for part in PARTS if part is not BASE
)

BALLAST_M: Final = 0.007
"""How far the centre of mass lies below that of buoyancy, m. Not of the paper, whose model has both
in one place and rolls whenever it turns with its bow down; every real vehicle is ballasted."""


def submerged_share(depth_m: float) -> float:
    """Tell how much of the hull is under water, 0…1, by the depth of its middle, m."""
    return min(1.0, max(0.0, 0.5 + depth_m / HEIGHT_M))


def net_weight_n(depth_m: float) -> float:
    """Return weight less buoyancy, N: 0 under water, since the vehicle is neutral."""
    displaced_kg = WATER_DENSITY_KG_M3 * VOLUME_M3 * submerged_share(depth_m)
    return (MASS_KG - displaced_kg) * GRAVITY_M_S2
