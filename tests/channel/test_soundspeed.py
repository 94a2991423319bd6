import pytest

from zacoustic.channel.formulae.soundspeed import (
    chen_millero_sound_speed_m_s,
    coppens_sound_speed_m_s,
    del_grosso_sound_speed_m_s,
    mackenzie_sound_speed_m_s,
    medwin_sound_speed_m_s,
    pressure_at_dbar,
)

# temperature, salinity, depth; then Medwin, Mackenzie, Coppens, Del Grosso, Chen-Millero.
POINTS = (
    (10, 35, 100, 1491.5900, 1491.4351, 1491.4194, 1491.4297, 1491.4827),
    (0, 35, 0, 1449.2000, 1448.9600, 1449.0500, 1449.0834, 1449.1388),
    (4, 35, 1000, 1482.7386, 1482.9552, 1483.0153, 1482.9381, 1483.2515),
    (15, 38, 50, 1511.1737, 1511.0664, 1510.9809, 1511.0138, 1510.9992),
    (20, 35, 10, 1521.6800, 1521.6262, 1521.6174, 1521.6444, 1521.6300),
    (27, 35, 10, 1539.1731, 1539.0866, 1539.1553, 1539.1730, 1539.2439),
)


@pytest.mark.parametrize("point", POINTS)
def test_sound_speeds_agree_with_the_reference_points(
    point: tuple[float, float, float, float, float, float, float, float],
) -> None:
    temperature, salinity, depth, medwin, mackenzie, coppens, del_grosso, chen_millero = point
    pressure = pressure_at_dbar(depth)
    assert medwin_sound_speed_m_s(temperature, salinity, depth) == pytest.approx(medwin, abs=6e-5)
    assert mackenzie_sound_speed_m_s(temperature, salinity, depth) == pytest.approx(
        mackenzie, abs=6e-5
    )
    assert coppens_sound_speed_m_s(temperature, salinity, depth) == pytest.approx(coppens, abs=6e-5)
    assert del_grosso_sound_speed_m_s(temperature, salinity, pressure) == pytest.approx(
        del_grosso, abs=6e-5
    )
    assert chen_millero_sound_speed_m_s(temperature, salinity, pressure) == pytest.approx(
        chen_millero, abs=6e-5
    )


def test_chen_millero_returns_the_check_value_of_unesco() -> None:
    assert chen_millero_sound_speed_m_s(40.0, 40.0, 10_000.0) == pytest.approx(1731.995, abs=5e-4)


def test_pressure_at_a_depth_agrees_with_the_equation_of_state() -> None:
    assert pressure_at_dbar(100.0) == pytest.approx(100.8429, abs=2e-4)
    assert pressure_at_dbar(0.0) == 0.0
    assert pressure_at_dbar(9712.653, latitude_deg=30.0) == pytest.approx(10_000.0, abs=0.01)
