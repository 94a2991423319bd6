"""Predicts the position of a vehicle from its speed and heading.

Position is the one field of a vehicle that no sum of other fields predicts: the way travelled north
is the speed times the cosine of the heading. So speed and heading give two quantities, the ways
north and east at the mean of two samples. Least squares find out how many steps of which position
these are worth, the error of magnetic north, and the effect of the current. While the heading
stays, the last change of the position is the better guess; so it is a quantity too, but only then.

A heading is the first number that wraps; a position is a number with many values; a speed is a
number with such a name. A vehicle without a speed field is assumed to move at constant speed.
"""

from collections.abc import Sequence
from typing import Final

from zacoustic.core.values.dense.coder.curve import POINT_BITS
from zacoustic.core.values.dense.model.layout import Column, Row
from zacoustic.core.values.dense.model.sine import SINE_BITS, direction

_POSITION_SIZE: Final = 1 << 15
_HEADING_SIZE: Final = 1 << 6
_SPEEDS: Final = ("speed", "velocity", "surge", "sog")
_STILL: Final = 100  # the assumed speed without a speed field, steps
_TURN: Final = 12  # from 30° on it is a turn
_SHIFT: Final = SINE_BITS - POINT_BITS + 1  # one bit more: the mean of two samples


class Course:
    """Heading, speed and positions of a type.

    Args:
        heading: Column of the heading.
        heading_size: Number of its values.
        speed: Column of the speed and its integer for 0; None: there is none.
        positions: Columns of the positions, in coding order.
    """

    def __init__(
        self,
        heading: int,
        heading_size: int,
        speed: tuple[int, int] | None,
        positions: list[int],
    ) -> None:
        self._heading = heading
        self._size = heading_size
        self._speed = speed
        self.positions = positions

    def ways(self, new: Row, old: Row, trends: list[int], steps: int) -> list[int]:
        """Return the quantities that predict the positions.

        Args:
            new: The row as far as it is known.
            old: The row of the reference.
            trends: The way of each column at the reference's velocity.
            steps: Steps between the two.

        Returns:
            The ways along and across heading 0, 1/16 of a speed's step times `steps`; then the
            trend of each position, 0 in a turn.
        """
        north = east = turn = 0
        size, place = self._size, self._heading
        for row in (old, new):
            heading, speed = row[place], _STILL
            if self._speed is not None:
                column, zero = self._speed
                speed = (row[column] or zero) - zero
            if heading is not None:
                along, across = direction(heading, size)
                north += speed * along
                east += speed * across
                turn = heading - turn
        turn = (turn + (size >> 1)) % size - (size >> 1)
        is_turn = abs(turn) * _TURN >= size
        return [
            north * steps >> _SHIFT,
            east * steps >> _SHIFT,
            *[0 if is_turn else trends[n] for n in self.positions],
        ]


def course_of(columns: Sequence[Column], order: Sequence[int]) -> Course | None:
    """Find heading, speed and positions among the columns.

    Args:
        columns: The columns of a type.
        order: The numbers among them in coding order.

    Returns:
        None if there is no heading, or if fewer than two positions are coded after it and the
        speed.
    """
    headings = [n for n in order if columns[n].wraps and columns[n].size >= _HEADING_SIZE]
    if not headings:
        return None
    speeds = [
        (n, zero)
        for n in order
        if columns[n].name.rpartition(".")[2].lower() in _SPEEDS
        and (zero := columns[n].zero) is not None
    ]
    speed = speeds[0] if speeds else None
    # Everything that the way depends on must be known before the first position.
    known = (headings[0], speed[0] if speed else None)
    positions = [n for n in order if columns[n].size >= _POSITION_SIZE and n not in known]
    if len(positions) < 2:
        return None
    last = max(order.index(headings[0]), order.index(speed[0]) if speed else 0)
    if order.index(positions[0]) < last:
        return None
    return Course(headings[0], columns[headings[0]].size, speed, positions)
