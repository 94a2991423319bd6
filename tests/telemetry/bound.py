"""What no coder of a kind can go below: the entropy of what a regression in hindsight leaves.

Each field is predicted by least squares, fitted to the very samples that it is measured on, from
the two samples before and from the fields before it in the same sample; what is left, in steps of
the field, costs the entropy of its own histogram. No framing, no ids, no model to send.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from zacoustic.core.values.types import FieldSpec, Lattice, TypeSpec


def bound_bytes(type_spec: TypeSpec, values: Sequence[Mapping[str, Any]]) -> float:
    """Mean bytes of a sample behind two others.

    Args:
        type_spec: Of the samples; fields with a lattice only.
        values: The samples in order, at least ten.
    """
    columns = [_steps(field, values) for field in type_spec.fields]
    angles = [
        _angle(field, column) for field, column in zip(type_spec.fields, columns, strict=True)
    ]
    whole = np.concatenate([np.stack(columns), *angles])
    one, two = whole[:, 1:-1], whole[:, :-2]
    bits = 0.0
    for place, column in enumerate(columns):
        constant = np.ones((1, len(column) - 2))
        before = np.stack(columns)[:place, 2:]
        given = _scaled(np.concatenate([one, one - two, before, constant])).T
        change = column[2:] - column[1:-1]
        weights, *_ = np.linalg.lstsq(given, change, rcond=None)
        # Of what seldom changes no line is better.
        bits += min(_entropy(np.rint(change - given @ weights)), _entropy(change))
    return bits / 8


def _steps(field: FieldSpec, values: Sequence[Mapping[str, Any]]) -> npt.NDArray[np.float64]:
    """A field in its steps; an angle goes on beyond a turn."""
    lattice = Lattice(field)
    column = np.array([lattice.index(value[field.name]) for value in values], dtype=float)
    return np.unwrap(column, period=lattice.size) if lattice.wraps else column


def _angle(field: FieldSpec, column: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Sine and cosine of an angle, from which a place goes on."""
    if not field.wraps:
        return np.empty((0, len(column)))
    turn = column / Lattice(field).size * math.tau
    return np.stack([np.sin(turn), np.cos(turn)])


def _scaled(rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    centred = rows - rows.mean(axis=1, keepdims=True)
    spread = centred.std(axis=1, keepdims=True)
    scaled = np.where(spread > 0, centred / np.where(spread > 0, spread, 1), 0)
    scaled[-1] = 1.0
    return scaled


def _entropy(column: npt.NDArray[np.float64]) -> float:
    counts = np.array([*Counter(column.tolist()).values()], dtype=float)
    shares = counts / counts.sum()
    return float(-(shares * np.log2(shares)).sum())
