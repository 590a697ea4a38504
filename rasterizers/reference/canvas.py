"""Canvas: one image while it is painted: its pairs in chunks, and where painting ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import threshold

from gsfw.core.numerics import NumericsProfile
from gsfw.rasterizers.reference.bin import PIXELS, Bins
from gsfw.rasterizers.reference.measure import Measurements

SLOTS = 32
"""Ellipses of a tile that are blended at once; measured: 16 to 64 differ little."""

LIVE_TENSORS = 12
"""Tensors with a number per tile, slot and pixel that are alive at once in the backward pass."""


@dataclass(frozen=True)
class CutOffs:
    """A profile's cut-offs as bounds that are themselves excluded, exact in one dtype."""

    alpha_below: float
    """The largest number under ``alpha_min``."""
    alpha_max: float
    alpha_above: float
    """The smallest number over ``alpha_max``."""
    transmittance_min: float

    @staticmethod
    def of(profile: NumericsProfile, dtype: torch.dtype) -> CutOffs:
        """The cut-offs of ``profile``."""
        alphas = torch.tensor([profile.alpha_min, profile.alpha_max], dtype=dtype)
        below, above = alphas.nextafter(alphas.new_tensor([-1.0, 2.0])).tolist()
        return CutOffs(below, alphas[1].item(), above, profile.transmittance_min)

    def clamp(self, raw: Tensor) -> Tensor:
        """Alpha from opacity times falloff."""
        return threshold(raw, self.alpha_below, 0.0).clamp_(max=self.alpha_max)

    def clamp_gradient(self, gradient: Tensor, raw: Tensor) -> Tensor:
        """The gradient where ``clamp`` neither skips nor clamps, 0 elsewhere."""
        # These two are single vectorised passes, where masks of booleans take ten times as long.
        return torch.ops.aten.hardtanh_backward(gradient, raw, self.alpha_below, self.alpha_above)

    def stop(self, values: Tensor, behind: Tensor) -> Tensor:
        """``values`` where the transmittance ``behind`` the slot stays above the stop, else 0."""
        return torch.ops.aten.threshold_backward(values, behind, self.transmittance_min)


@dataclass(frozen=True)
class Chunk:
    """Some tiles and their next slots; slots beyond a tile's last pair hold -1."""

    tiles: Int[Tensor, " t"]
    pairs: Int[Tensor, "t s"]
    ahead: Float[Tensor, "t p"]
    """Transmittance in front of the first slot, as if painting never stopped."""


@dataclass(frozen=True)
class Canvas:
    """What painting one image needs besides the brushes."""

    bins: Bins
    inside: Float[Tensor, "tiles p"]
    """1 for the pixels of the image, 0 for what tiles have beyond it."""
    cut_offs: CutOffs
    chunk_mb: float
    """Working memory of a chunk."""
    measurements: Measurements

    def chunks(self, ahead: Float[Tensor, "tiles p"]) -> Iterator[Chunk]:
        """The pairs of the image in chunks, in which all tiles advance from front to back.

        The caller brings ``ahead`` up to date with each chunk before it asks for the next; tiles
        all of whose pixels have stopped are left out.
        """
        slots_bytes = LIVE_TENSORS * SLOTS * PIXELS * ahead.element_size()
        tiles_at_once = max(1, int(self.chunk_mb * 2**20 / slots_bytes))
        starts, counts = self.bins.starts, self.bins.counts
        by_count = counts.argsort(stable=True)
        for first in range(0, int(counts.max()), SLOTS):
            waiting = (counts > first) & (ahead.amax(1) > self.cut_offs.transmittance_min)
            tiles_waiting = by_count[waiting[by_count]]
            if len(tiles_waiting) == 0:  # Splitting nothing would yield one empty chunk.
                return
            for tiles in tiles_waiting.split(tiles_at_once):
                left = (counts[tiles] - first)[:, None]
                slots = torch.arange(min(SLOTS, int(left.max())), device=tiles.device)
                pairs = torch.where(slots < left, starts[tiles, None] + first + slots, -1)
                yield Chunk(tiles, pairs, ahead[tiles])
