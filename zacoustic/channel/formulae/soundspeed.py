"""Speed of sound in sea water, after five authors, and the pressure that two of them need.

They agree within 0.1 m/s in ordinary water. The choice matters less than an accurate temperature:
1 °C is 3…4.6 m/s. `mackenzie_sound_speed_m_s` is the default if a profile is known; scenarios take
a constant instead. `medwin` is the shortest, `coppens` covers brackish water, `del_grosso` and
`chen_millero` are standards for calibration and take a pressure, which `pressure_at_dbar` computes.

Temperature is in °C, salinity in practical salinity units (psu), depth in m, positive down.
Validity ranges are stated, not enforced: outside of them the errors grow slowly.
"""

import math
from typing import Final

_KG_CM2_PER_DBAR: Final = 0.101971621
_BAR_PER_DBAR: Final = 0.1
_PRESSURE_STEPS: Final = 6  # Newton; three suffice for ten digits


def mackenzie_sound_speed_m_s(temperature_c: float, salinity_psu: float, depth_m: float) -> float:
    """Sound speed after Mackenzie; the default.

    Args:
        temperature_c: 2…30 °C.
        salinity_psu: 25…40.
        depth_m: 0…8000 m.

    Returns:
        Sound speed, m/s; stated standard error 0.07 m/s.

    Source:
        K. V. Mackenzie, J. Acoust. Soc. Am. 70 (1981) 807.
    """
    t, s, d = temperature_c, salinity_psu - 35.0, depth_m
    return (
        1448.96
        + 4.591 * t
        - 5.304e-2 * t**2
        + 2.374e-4 * t**3
        + 1.340 * s
        + 1.630e-2 * d
        + 1.675e-7 * d**2
        - 1.025e-2 * t * s
        - 7.139e-13 * t * d**3
    )


def medwin_sound_speed_m_s(temperature_c: float, salinity_psu: float, depth_m: float) -> float:
    """Sound speed after Medwin: short, for shallow water.

    Args:
        temperature_c: 0…35 °C.
        salinity_psu: 0…45.
        depth_m: 0…1000 m.

    Returns:
        Sound speed, m/s.

    Source:
        H. Medwin, J. Acoust. Soc. Am. 58 (1975) 1318.
    """
    t, s = temperature_c, salinity_psu - 35.0
    return (
        1449.2 + 4.6 * t - 0.055 * t**2 + 0.00029 * t**3 + (1.34 - 0.010 * t) * s + 0.016 * depth_m
    )


def coppens_sound_speed_m_s(temperature_c: float, salinity_psu: float, depth_m: float) -> float:
    """Sound speed after Coppens: also for brackish water.

    Args:
        temperature_c: 0…35 °C.
        salinity_psu: 0…45.
        depth_m: 0…4000 m.

    Returns:
        Sound speed, m/s.

    Source:
        A. B. Coppens, J. Acoust. Soc. Am. 69 (1981) 862.
    """
    t, s, d = temperature_c / 10.0, salinity_psu - 35.0, depth_m / 1000.0
    surface = (
        1449.05 + 45.7 * t - 5.21 * t**2 + 0.23 * t**3 + (1.333 - 0.126 * t + 0.009 * t**2) * s
    )
    return (
        surface
        + (16.23 + 0.253 * t) * d
        + (0.213 - 0.1 * t) * d**2
        + (0.016 + 0.0002 * s) * s * t * d
    )


def del_grosso_sound_speed_m_s(
    temperature_c: float, salinity_psu: float, pressure_dbar: float
) -> float:
    """Sound speed after Del Grosso, in Wong and Zhu's coefficients for today's temperature scale.

    Args:
        temperature_c: 0…30 °C.
        salinity_psu: 30…40.
        pressure_dbar: Pressure above that of the air, dbar, 0…9800; see `pressure_at_dbar`.

    Returns:
        Sound speed, m/s.

    Source:
        V. A. Del Grosso, J. Acoust. Soc. Am. 56 (1974) 1084; G. S. K. Wong, S. Zhu, J. Acoust. Soc.
        Am. 97 (1995) 1732.
    """
    t, s, p = temperature_c, salinity_psu, pressure_dbar * _KG_CM2_PER_DBAR
    by_temperature = 5.012285 * t - 5.51184e-2 * t**2 + 2.21649e-4 * t**3
    by_salinity = 1.329530 * s + 1.288598e-4 * s**2
    by_pressure = 0.1560592 * p + 2.449993e-5 * p**2 - 8.833959e-9 * p**3
    by_all = (
        -1.275936e-2 * s * t
        + 6.353509e-3 * t * p
        + 2.656174e-8 * t**2 * p**2
        - 1.593895e-6 * t * p**2
        + 5.222483e-10 * t * p**3
        - 4.383615e-7 * t**3 * p
        - 1.616745e-9 * s**2 * p**2
        + 9.688441e-5 * s * t**2
        + 4.857614e-6 * s**2 * t * p
        - 3.406824e-4 * s * t * p
    )
    return 1402.392 + by_temperature + by_salinity + by_pressure + by_all


# Rows: powers of pressure in bar; columns: powers of temperature.
_PURE_WATER: Final = (
    (1402.388, 5.03711, -5.80852e-2, 3.3420e-4, -1.47800e-6, 3.1464e-9),
    (0.153563, 6.8982e-4, -8.1788e-6, 1.3621e-7, -6.1185e-10),
    (3.1260e-5, -1.7107e-6, 2.5974e-8, -2.5335e-10, 1.0405e-12),
    (-9.7729e-9, 3.8504e-10, -2.3643e-12),
)
_PER_SALINITY: Final = (
    (1.389, -1.262e-2, 7.164e-5, 2.006e-6, -3.21e-8),
    (9.4742e-5, -1.2580e-5, -6.4885e-8, 1.0507e-8, -2.0122e-10),
    (-3.9064e-7, 9.1041e-9, -1.6002e-10, 7.988e-12),
    (1.100e-10, 6.649e-12, -3.389e-13),
)
_PER_SALINITY_1_5: Final = ((-1.922e-2, -4.42e-5), (7.3637e-5, 1.7945e-7))
_PER_SALINITY_SQUARED: Final = ((1.727e-3,), (-7.9836e-6,))


def chen_millero_sound_speed_m_s(
    temperature_c: float, salinity_psu: float, pressure_dbar: float
) -> float:
    """Sound speed after Chen and Millero, the UNESCO algorithm.

    Args:
        temperature_c: 0…40 °C.
        salinity_psu: 0…40.
        pressure_dbar: Pressure above that of the air, dbar, 0…10 000; see `pressure_at_dbar`.

    Returns:
        Sound speed, m/s. UNESCO's check value: 1731.995 at 40 °C, 40 psu, 10 000 dbar.

    Source:
        C.-T. Chen, F. J. Millero, J. Acoust. Soc. Am. 62 (1977) 1129; UNESCO Technical Papers in
        Marine Science 44 (1983).
    """
    t, s, p = temperature_c, salinity_psu, pressure_dbar * _BAR_PER_DBAR
    return (
        _polynomial(_PURE_WATER, p, t)
        + _polynomial(_PER_SALINITY, p, t) * s
        + _polynomial(_PER_SALINITY_1_5, p, t) * math.pow(s, 1.5)
        + _polynomial(_PER_SALINITY_SQUARED, p, t) * s**2
    )


def pressure_at_dbar(depth_m: float, *, latitude_deg: float = 45.0) -> float:
    """Pressure above that of the air at a depth, in the standard ocean.

    Args:
        depth_m: 0…10 000 m.
        latitude_deg: −90…90°, for the earth's gravity.

    Returns:
        Pressure, dbar; 1 dbar is nearly 1 m.

    Source:
        Inverse of P. M. Saunders, N. P. Fofonoff, Deep-Sea Res. 23 (1976) 109 (UNESCO 44).
    """
    sine = math.sin(math.radians(latitude_deg)) ** 2
    gravity = 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * sine) * sine)
    pressure = depth_m
    for _ in range(_PRESSURE_STEPS):
        work = (
            ((-1.82e-15 * pressure + 2.279e-10) * pressure - 2.2512e-5) * pressure + 9.72659
        ) * (pressure)
        here = gravity + 1.092e-6 * pressure
        pressure -= (work / here - depth_m) * here / 9.72659
    return pressure


def _polynomial(rows: tuple[tuple[float, ...], ...], pressure: float, temperature: float) -> float:
    total = 0.0
    for row in reversed(rows):
        by_temperature = 0.0
        for coefficient in reversed(row):
            by_temperature = by_temperature * temperature + coefficient
        total = total * pressure + by_temperature
    return total
