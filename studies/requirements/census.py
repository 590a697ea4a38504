"""Census: the floats of a model by purpose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsfw.core.column import Column, Layout
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE, num_coefficients
from gsfw.core.model import PrimitiveModel

FLOAT_BYTES = 4
CONSTANT, BANDS = "sh_dc", "sh_rest"
"""Columns of SH coefficients in built-in models; a flag marks bands as well."""
BAND = "SH band "
"""Beginning of the names of groups of SH coefficients; the band's number follows."""
TIME = "time parameters"
PURPOSES = {
    "means": "positions",
    "quats": "rotations and sizes",
    "log_scales": "rotations and sizes",
    "opacity_logits": "opacities",
}
"""Purposes of columns of these names; all others go by their own names."""


@dataclass(frozen=True)
class Census:
    """Numbers of floats of a model."""

    floats: Mapping[str, int]
    """Floats that rendering needs, by purpose."""
    for_training: Mapping[str, int]
    """Floats that only training needs, by name: moments and columns."""
    rows_by_degree: tuple[int, ...]
    """Number of rows with each SH degree, from 0 on; empty without spherical harmonics."""
    highest_degree: int
    """Highest possible degree: that of the settings where rows differ in it; 0 without bands."""
    rows_without_time: int
    """Number of rows without time parameters in a model of which others have some."""

    @property
    def sh_floats(self) -> int:
        """Floats of spherical harmonics."""
        names = (band_name(band) for band in range(MAX_DEGREE + 1))
        return sum(self.floats.get(name, 0) for name in names)

    @property
    def sh_floats_full(self) -> int:
        """Floats of spherical harmonics if all rows had the highest degree."""
        return sum(self.rows_by_degree) * 3 * num_coefficients(self.highest_degree)

    @staticmethod
    def of(model: PrimitiveModel, optimizer: Optimizer, degree: int | None) -> Census:
        """Count the floats of a model.

        Args:
            model: whose floats are counted.
            optimizer: that trained it.
            degree: the highest SH degree by the run's settings; ``None`` when they have none.
        """
        columns, temporal = model.columns(), model.temporal_columns()
        floats: dict[str, int] = {}
        for_training = {"optimizer": optimizer.num_bytes() // FLOAT_BYTES}
        for name, column in columns.items():
            if not is_drawn(column, name in temporal):
                for_training[name] = _floats(column.values)
                continue
            for purpose, count in _purposes(name, column, name in temporal).items():
                floats[purpose] = floats.get(purpose, 0) + count
        for group in model.parameter_groups():
            floats[group.name] = sum(_floats(tensor) for tensor in group.parameters)
        rows = _rows_by_degree(columns)
        return Census(
            floats,
            for_training,
            rows_by_degree=rows,
            highest_degree=_highest_degree(columns, rows, degree),
            rows_without_time=int(_empty_rows(temporal).sum()),
        )


def band_name(band: int) -> str:
    """Name of the coefficients of an SH band."""
    return f"{BAND}{band}"


def _floats(values: Tensor) -> int:
    """Size of a tensor in numbers of four bytes."""
    return -(-values.nbytes // FLOAT_BYTES)


def is_drawn(column: Column, is_temporal: bool) -> bool:
    """True if rendering needs a column; others exist for training alone."""
    return column.trained or is_temporal


def is_bands(name: str, column: Column) -> bool:
    """True if a column holds the SH coefficients above the constant one."""
    return name == BANDS or column.bands


def _purposes(name: str, column: Column, is_temporal: bool) -> dict[str, int]:
    """The floats of a column by purpose."""
    if is_temporal:
        return {TIME: _floats(column.values)}
    if name == CONSTANT:
        return {band_name(0): _floats(column.values)}
    if not is_bands(name, column):
        return {PURPOSES.get(name, name.replace("_", " ")): _floats(column.values)}
    found, lengths = {}, _lengths(column)
    each = _floats(column.values) / max(int(lengths.sum()), 1)
    for band in range(1, MAX_DEGREE + 1):
        before = num_coefficients(band - 1) - 1
        count = int((lengths - before).clamp(0, 2 * band + 1).sum())
        if count or (column.layout is Layout.DENSE and before < column.values.shape[1]):
            found[band_name(band)] = round(count * each)
    return found


def _lengths(column: Column) -> Int[Tensor, " n"]:
    """Number of coefficients above the constant one of each row."""
    if column.offsets is not None:
        return column.offsets.diff()
    return torch.full((column.num_rows,), column.values.shape[1])


def _rows_by_degree(columns: Mapping[str, Column]) -> tuple[int, ...]:
    """Number of rows with each degree."""
    for name, column in columns.items():
        if is_bands(name, column):
            # Degree d has (d + 1)^2 - 1 coefficients above the constant one.
            degrees = _lengths(column).double().sqrt().long()
            return tuple(degrees.bincount(minlength=1).tolist())
    constant = columns.get(CONSTANT)
    return () if constant is None else (constant.num_rows,)


def _highest_degree(
    columns: Mapping[str, Column], rows: tuple[int, ...], degree: int | None
) -> int:
    """Degree of the settings where rows differ in it; else the degree of all rows."""
    found = max(len(rows) - 1, 0)
    is_ragged = any(
        is_bands(name, column) and column.layout is Layout.RAGGED
        for name, column in columns.items()
    )
    return max(found, degree) if is_ragged and degree is not None else found


def _empty_rows(temporal: Mapping[str, Column]) -> Bool[Tensor, " n"]:
    """Rows without a value in any temporal column."""
    if not temporal:
        return torch.zeros(0, dtype=torch.bool)
    empty = [
        column.offsets.diff() == 0
        if column.offsets is not None
        else torch.zeros(column.num_rows, dtype=torch.bool, device=column.values.device)
        for column in temporal.values()
    ]
    return torch.stack(empty).all(0)
