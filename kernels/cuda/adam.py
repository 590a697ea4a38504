"""Adam: one step for many tensors in two launches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.autograd.graph import increment_version

from gsfw.core.operators import GRADIENT_LIMIT, AdamSettings, AdamUpdate
from gsfw.kernels.cuda import step_jobs
from gsfw.kernels.cuda.instances import kernel_of
from gsfw.kernels.cuda.launcher import Launcher, address

WIDTH_LIMIT = 2**31
"""Numbers that a row must be shorter than."""

ALIGNMENT = 16
"""Bytes that a thread moves at once where all arrays begin at multiples of it."""

BLOCK_NUMBERS = step_jobs.ADAM_THREADS * step_jobs.ADAM_NUMBERS
"""Numbers that a block steps."""


@dataclass(frozen=True)
class TableShape:
    """A tensor as a table in memory whose rows may lie apart."""

    width: int
    """Numbers of a row, which lie next to each other."""
    stride: int
    """Numbers from one row to the next."""


def table_shape(tensor: Tensor) -> TableShape | None:
    """The shape of a tensor as rows of its first axis; ``None`` where it is no table.

    Sizes and strides alone are looked at: views would cost more than the launch they are for.
    """
    if tensor.dim() == 0 or tensor.numel() == 0:
        return None
    (_, *sizes), (stride, *strides) = tensor.shape, tensor.stride()
    width = 1
    for size, step in zip(reversed(sizes), reversed(strides), strict=True):
        if size > 1 and step != width:
            return None
        width *= size
    return TableShape(width, stride) if width < WIDTH_LIMIT else None


def adam_table(update: AdamUpdate, finite: Tensor) -> step_jobs.AdamTable | None:
    """The table of an update but for its first block; ``None`` where kernels do not serve it."""
    values, moments, rows = update.values, update.moments, update.rows
    rate = update.rate if isinstance(update.rate, Tensor) else None
    tensors = (values, update.gradient, moments.first, moments.second)
    shapes = [table_shape(tensor) for tensor in tensors if tensor.shape == values.shape]
    found = [shape for shape in shapes if shape is not None]
    beside = [(finite, torch.bool), (moments.count, torch.float64)]
    if rows is not None:
        beside.append((rows, torch.int64))
    if rate is not None:
        beside.append((rate, torch.float64))
    readable = all(
        tensor.device == values.device and tensor.dtype == dtype and tensor.is_contiguous()
        for tensor, dtype in beside
    )
    if len(found) < len(tensors) or not readable:
        return None
    addresses = [tensor.data_ptr() for tensor in tensors]
    parts = zip(addresses, found, strict=True)
    width, count = found[0].width, len(values)
    dense = all(shape.stride == width for shape in found) or count == 1
    return step_jobs.AdamTable(
        *(step_jobs.AdamRows(place, shape.stride) for place, shape in parts),
        rows=address(rows),
        count=count if rows is None else len(rows),
        width=width,
        rate=0.0 if rate is not None else float(update.rate),
        rate_at=address(rate),
        steps=address(moments.count),
        whole=dense and rows is None,
        aligned=all(place % ALIGNMENT == 0 for place in addresses),
    )


def step_tables(
    launcher: Launcher,
    updates: Sequence[AdamUpdate],
    tables: Sequence[step_jobs.AdamTable],
    settings: AdamSettings,
    finite: Tensor,
) -> None:
    """Step at most ``ADAM_TABLES`` tables of one number type, those of the updates."""
    values = updates[0].values
    scales = values.new_empty(len(tables), 2)
    job = step_jobs.AdamJob(
        beta1=settings.beta1,
        beta2=settings.beta2,
        epsilon=settings.epsilon,
        gradient_limit=GRADIENT_LIMIT,
        finite=address(finite),
        scales=address(scales),
        count=len(tables),
    )
    blocks = 0
    for index, table in enumerate(tables):
        table.first_block = blocks
        job.tables[index] = table
        blocks += -(-table.count * table.width // BLOCK_NUMBERS)
    begin, step = (kernel_of("adam.cu", name, values.dtype) for name in ("begin_adam", "adam"))
    launcher.launch(begin, 1, step_jobs.WARP, job)
    launcher.launch(step, blocks, step_jobs.ADAM_THREADS, job)
    for update in updates:
        moments = update.moments
        for changed in (update.values, moments.first, moments.second, moments.count):
            increment_version(changed)
