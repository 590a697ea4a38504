"""Buckets: splats of one block of space, so that 16 bits give their positions in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, Int64
from torch import Tensor

BUCKET = 256
"""Splats of a full bucket, as in the original."""


@dataclass(frozen=True)
class Buckets:
    """All splats in buckets: the full ones first, then one or none of each block."""

    order: Int[Tensor, " n"] | None
    """Rows in the order of the buckets; ``None`` for their own."""
    lengths: Int64[np.ndarray, " b"]
    centers: Float32[np.ndarray, "b 3"]
    full: int
    """Number of full buckets."""


NONE = Buckets(None, np.zeros(0, np.int64), np.zeros((0, 3), np.float32), 0)
"""No buckets: level 0 needs none."""


def buckets_of(means: Float[Tensor, "n 3"], block: float) -> Buckets:
    """Splats by blocks of a side; in each block in the order of the rows."""
    points = means.double().numpy()
    low = points.min(axis=0)
    # As float64: they may be more than integers hold.
    cells = np.floor((points - low) / block)
    by_cell = np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0]))
    cells = cells[by_cell]
    starts = np.flatnonzero(np.append(True, (cells[1:] != cells[:-1]).any(axis=1)))
    counts = np.diff(np.append(starts, len(cells)))
    rank = np.arange(len(cells)) - starts.repeat(counts)
    in_full = rank < (counts // BUCKET * BUCKET).repeat(counts)
    order = np.concatenate([by_cell[in_full], by_cell[~in_full]])
    middles = (cells[starts] + 0.5) * block + low
    fulls, rests = counts // BUCKET, counts % BUCKET
    return Buckets(
        order=torch.from_numpy(order),
        lengths=np.concatenate([np.full(fulls.sum(), BUCKET), rests[rests > 0]]),
        centers=np.concatenate([middles.repeat(fulls, axis=0), middles[rests > 0]]).astype("<f4"),
        full=int(fulls.sum()),
    )
