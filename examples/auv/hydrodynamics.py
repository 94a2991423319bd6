"""What water does to a moving hull: added mass, quadratic damping, lift and drag of the fins.

Fossen's model with the coefficients of the paper's vehicle (LRAUV Tethys in Gazebo). The Coriolis
matrix of the added mass is left out, as the makers of that vehicle do: with it the model turns on
the spot by itself. Velocities are those through the water.
"""

import math
from typing import Final

from examples.auv.hull import WATER_DENSITY_KG_M3

ADDED_MASS: Final = (4.876161, 126.324739, 126.324739, 0.0, 33.46, 33.46)
"""Of u, v, w, kg, and p, q, r, kg·m²."""
DAMPING: Final = (6.2282, 601.27, 601.27, 0.1916, 632.698957, 632.698957)
"""Force over speed squared, N·s²/m², and moment over rate squared, N·m·s²."""

FIN_AREA_M2: Final = 0.0244
FIN_X_M: Final = -1.05
LIFT_SLOPE: Final = 4.13
"""Of the lift coefficient, 1/rad, up to the stall."""
LIFT_SLOPE_STALLED: Final = -1.1
DRAG_SLOPE: Final = 0.2
DRAG_SLOPE_STALLED: Final = 0.03
STALL_RAD: Final = 0.17
FIN_LIMIT_RAD: Final = 0.261799
"""Both joints turn so far, either way."""
THRUST_LIMIT_N: Final = 60.0

_PRESSURE: Final = 0.5 * WATER_DENSITY_KG_M3 * FIN_AREA_M2


def coefficients(incidence_rad: float) -> tuple[float, float]:
    """Return the coefficients of lift and drag of a fin; the first has the sign of the angle."""
    size = abs(incidence_rad)
    if size <= STALL_RAD:
        return LIFT_SLOPE * incidence_rad, DRAG_SLOPE * size
    beyond = size - STALL_RAD
    lift = max(0.0, LIFT_SLOPE * STALL_RAD + LIFT_SLOPE_STALLED * beyond)
    drag = abs(DRAG_SLOPE * STALL_RAD + DRAG_SLOPE_STALLED * beyond)
    return math.copysign(lift, incidence_rad), drag


def fin_force(
    forward_m_s: float, across_m_s: float, along_m_s: float, angle_rad: float
) -> tuple[float, float]:
    """Return what a fin does, N: forward, and across.

    Args:
        forward_m_s: Speed of the fin through the water, forward.
        across_m_s: The same, in the direction in which its lift acts.
        along_m_s: The same, along its span: a swept flow lifts less.
        angle_rad: Of the fin; positive: its leading edge points across.

    Returns:
        Zero while the flow comes from behind, as in Gazebo.
    """
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    if forward_m_s * cosine + across_m_s * sine <= 0.0:
        return 0.0, 0.0
    squared = forward_m_s * forward_m_s + across_m_s * across_m_s
    speed = math.sqrt(squared)
    incidence = angle_rad - math.atan2(across_m_s, forward_m_s)
    lift_coefficient, drag_coefficient = coefficients(incidence)
    swept = squared / (squared + along_m_s * along_m_s)
    pressure = _PRESSURE * squared * swept
    lift, drag = pressure * lift_coefficient, pressure * drag_coefficient
    # Lift is across the flow, drag against the motion.
    ahead, aside = forward_m_s / speed, across_m_s / speed
    return -lift * aside - drag * ahead, lift * ahead - drag * aside
