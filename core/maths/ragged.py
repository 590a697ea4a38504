"""Ragged rows: rows with their own numbers of values, stored one row after another."""

from __future__ import annotations

import torch
from jaxtyping import Int
from torch import Tensor


def row_offsets(lengths: Int[Tensor, " n"]) -> Int[Tensor, " n_plus_1"]:
    """The start of each row among the values, and the end of the last one."""
    return torch.cat([lengths.new_zeros(1), lengths.cumsum(0)])


def value_rows(lengths: Int[Tensor, " n"]) -> Int[Tensor, " m"]:
    """The row of each value."""
    return torch.arange(len(lengths), device=lengths.device).repeat_interleave(lengths)


def value_indices(starts: Int[Tensor, " n"], lengths: Int[Tensor, " n"]) -> Int[Tensor, " m"]:
    """start, start + 1, ... for each row, as many as its length, one row after the other."""
    shifts = (starts - row_offsets(lengths)[:-1]).repeat_interleave(lengths)
    return torch.arange(len(shifts), device=shifts.device) + shifts
