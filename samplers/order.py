"""The order of an epoch, from the seed and the epoch's number alone."""

from __future__ import annotations

from functools import lru_cache

import torch

SEED_STRIDE = 1_000_003
"""A prime: neighbouring seeds, epochs and parts do not share their orders."""


def epoch_generator(seed: int, epoch: int, part: int = 0) -> torch.Generator:
    """A generator for an epoch, or for a part of one; the same whenever it is asked for.

    Args:
        seed: of the run.
        epoch: counted from 0.
        part: parts of an epoch draw differently.
    """
    mixed = (seed * SEED_STRIDE + epoch) * SEED_STRIDE + part
    return torch.Generator().manual_seed(mixed % 2**63)


@lru_cache(maxsize=8)
def epoch_order(count: int, seed: int, epoch: int, part: int = 0) -> tuple[int, ...]:
    """A permutation of ``count`` things; looking ahead needs no state, and changes none.

    Args:
        count: how many things.
        seed: of the run.
        epoch: counted from 0.
        part: parts of an epoch have orders of their own.
    """
    generator = epoch_generator(seed, epoch, part)
    return tuple(torch.randperm(count, generator=generator).tolist())
