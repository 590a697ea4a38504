"""Half precision: the tensors of a model that lose nothing visible when stored in float16."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from gsfw.core.column import Layout
from gsfw.core.exchange import StoredModel

FEW = 1024
"""Tensors that are no columns and have fewer values are times, boxes and biases: they stay."""
ROUNDING = 2.0**-10
"""Largest rounding of a tensor relative to its values, both as root mean squares: twice that of
float16 where it has all of its 11 bits. Tensors of tiny values lose more, and stay."""
OF_A_SPLAT, MOST_ROWS = 1 / 8, 0.9
"""Largest rounding of a position, relative to the shortest axis of its splat, for this share of the
rows. (On the built-in scene half of the rows are rounded by less than 1/20, and a twentieth by more
than 0.4: that costs 0.14 dB.)"""
PLACES = ("means", "past_means")
"""Columns of positions."""
SCALES = "log_scales"


def halved(model: StoredModel) -> Mapping[str, Tensor]:
    """The tensors of a model's state that can be stored in float16, in that type, by name."""
    columns = {column.values: name for name, column in model.columns.items()}
    found = {}
    for name, tensor in model.state.items():
        column = columns.get(name, "")
        if tensor.dtype != torch.float32 or (not column and tensor.numel() < FEW):
            continue
        half = tensor.half()
        if not _is_near(tensor, half):
            continue
        if column in PLACES and not _is_small(model, column, tensor, half):
            continue
        found[name] = half
    return found


def _is_near(tensor: Tensor, half: Tensor) -> bool:
    """True if all values are within the range of float16, and most of them far from its end."""
    values = tensor.double()
    lost = (half.double() - values).square().mean().sqrt()
    return bool(half.isfinite().all()) and bool(lost <= ROUNDING * values.square().mean().sqrt())


def _is_small(model: StoredModel, column: str, tensor: Tensor, half: Tensor) -> bool:
    """True if the rounding of positions is small for nearly all splats."""
    scales = model.columns.get(SCALES)
    if scales is None or scales.layout is not Layout.DENSE or not tensor.numel():
        return False
    shortest = model.state[scales.values].amin(dim=1).double().exp()
    lost = (half.double() - tensor.double()).abs().amax(dim=-1)
    return bool((lost <= OF_A_SPLAT * shortest).double().mean() >= MOST_ROWS)
