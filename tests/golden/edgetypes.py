"""Types, models and numbers of the scenes in `tests/golden/edges.json`."""

from typing import Any

from zacoustic.core.values.dense import StreamPrior
from zacoustic.core.values.dense.model.adaptation import SITUATIONS
from zacoustic.core.values.dense.model.layout import Layout
from zacoustic.core.values.dense.model.prior import Learnt
from zacoustic.core.values.dense.model.rowmodel import RowModel
from zacoustic.core.values.types import FieldSpec, TypeSpec


class Numbers:
    """A generator of integers, so that no library has a say."""

    def __init__(self, state: int = 2026) -> None:
        self._state = state

    def below(self, size: int) -> int:
        """Return one of `size` integers."""
        self._state = (self._state * 6364136223846793005 + 1442695040888963407) % (1 << 64)
        return (self._state >> 33) % size


def number(name: str, low: float, high: float, step: float, **more: Any) -> FieldSpec:
    """Make a field."""
    return FieldSpec(name=name, type="float64", range=(low, high), step=step, **more)


def type_of(name: str, *fields: FieldSpec) -> TypeSpec:
    """Make a type."""
    return TypeSpec(name=name, fields=fields)


def model_of(spec: TypeSpec) -> RowModel:
    """Return the columns of a type."""
    return RowModel(Layout(spec).columns)


def plain_prior(spec: TypeSpec, **more: Any) -> StreamPrior:
    """Return what says nothing of a stream."""
    return StreamPrior(sizes=tuple(model_of(spec).sizes), **more)


def learnt(
    spec: TypeSpec, *, weight: int, log_scale: int, nearer: int, width: int, hold: int = 1024
) -> Learnt:
    """Return an adaptation whose last number follows from the steps alone."""
    model = model_of(spec)
    count, columns = model.shape.quantities, len(model.sizes)
    rows = [[0] * k for k in range(count)]
    rows[-1][0] = weight
    return Learnt(
        weights=tuple(map(tuple, rows)),
        energies=(1 << 40,) * count,
        log_scales=(log_scale,) * columns,
        widths=(width,) * (SITUATIONS * columns),
        nearer=(nearer,) * columns,
        holds=(hold,) * columns,
    )


def drawn(spec: TypeSpec, state: int) -> Learnt:
    """Return an adaptation with numbers of all kinds."""
    rng, model = Numbers(state), model_of(spec)
    count, columns = model.shape.quantities, len(model.sizes)
    return Learnt(
        weights=tuple(tuple(rng.below(40000) - 20000 for _ in range(k)) for k in range(count)),
        energies=tuple(64 + rng.below(1 << 14) for _ in range(count)),
        log_scales=tuple(2000 + rng.below(6000) for _ in range(columns)),
        widths=tuple(rng.below(8192) for _ in range(SITUATIONS * columns)),
        nearer=tuple(rng.below(65537) for _ in range(columns)),
        holds=tuple(1 + rng.below(65206) for _ in range(columns)),
    )
