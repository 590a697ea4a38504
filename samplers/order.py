"""The order of an epoch, as a function of the seed and the epoch's number alone."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import torch

SEED_STRIDE = 1_000_003
"""A prime: neighbouring seeds, epochs and parts have distinct orders."""


def epoch_generator(seed: int, epoch: int, part: int = 0) -> torch.Generator:
    """A generator for an epoch, or for a part of one; the same at every call.

    Args:
        seed: seed of the run.
        epoch: number of the epoch, counted from 0.
        part: part of the epoch, with random numbers of its own.
    """
    mixed = (seed * SEED_STRIDE + epoch) * SEED_STRIDE + part
    return torch.Generator().manual_seed(mixed % 2**63)


@lru_cache(maxsize=8)
def epoch_order(count: int, seed: int, epoch: int, part: int = 0) -> tuple[int, ...]:
    """A permutation of ``count`` items; a preview needs no state, and changes none.

    Args:
        count: number of items.
        seed: seed of the run.
        epoch: number of the epoch, counted from 0.
        part: part of the epoch, with an order of its own.
    """
    generator = epoch_generator(seed, epoch, part)
    return tuple(torch.randperm(count, generator=generator).tolist())


def item_at(position: int, items: Sequence[int], seed: int, part: int = 0) -> int:
    """The item at a position of endless epochs, each with all items in an order of its own.

    Args:
        position: number of items before it, over all epochs.
        items: at least one.
        seed: seed of the run.
        part: part of the run, with orders of its own.
    """
    epoch, within = divmod(position, len(items))
    return items[epoch_order(len(items), seed, epoch, part)[within]]
