"""The order of an epoch, from the seed and the epoch's number alone."""

from __future__ import annotations

from functools import lru_cache

import torch

SEED_STRIDE = 1_000_003
"""A prime: neighbouring seeds, epochs and parts do not share their orders."""


@lru_cache(maxsize=8)
def epoch_order(count: int, seed: int, epoch: int, part: int = 0) -> tuple[int, ...]:
    """A permutation of ``count`` things; looking ahead needs no state, and changes none.

    Args:
        count: how many things.
        seed: of the run.
        epoch: counted from 0.
        part: parts of an epoch have orders of their own.
    """
    mixed = (seed * SEED_STRIDE + epoch) * SEED_STRIDE + part
    generator = torch.Generator().manual_seed(mixed % 2**63)
    return tuple(torch.randperm(count, generator=generator).tolist())
