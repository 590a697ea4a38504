"""Tile buffer: an image while it is blended, its tile intersections in chunks, its statistics."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import threshold

from gsfw.core.cameras import Cameras
from gsfw.core.numerics import NumericsProfile
from gsfw.core.render_output import RenderStatistics
from gsfw.rasterizers.reference.bin import PIXELS, Bins

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
    """Transmittance in front of the first slot, as if blending never stopped."""


@dataclass(frozen=True)
class Measurements:
    """Statistics of one camera, filled tile by tile; ``None`` for those that are not requested."""

    rows: Int[Tensor, " m"]
    """The splat of each ellipse."""
    half_size: Float[Tensor, " 2"]
    """Half the image's sides: pixels per unit of NDC."""
    screen_gradient: Float[Tensor, " n"] | None
    absgrad: Float[Tensor, " n"] | None
    contribution: Float[Tensor, " n"] | None
    pixel_weights: Float[Tensor, "tiles p"] | None
    """Weights of pixels in ``contribution``; ``None`` for ones."""

    @staticmethod
    def of(
        statistics: RenderStatistics,
        index: int,
        rows: Int[Tensor, " m"],
        camera: Cameras,
        pixel_weights: Float[Tensor, "tiles p"] | None,
    ) -> Measurements:
        """The rows of ``statistics`` that belong to camera ``index``."""

        def row(tensor: Tensor | None) -> Tensor | None:
            return None if tensor is None else tensor[index]

        return Measurements(
            rows=rows,
            half_size=0.5 * statistics.radii.new_tensor([camera.width, camera.height]),
            screen_gradient=row(statistics.screen_gradient),
            absgrad=row(statistics.absgrad),
            contribution=row(statistics.contribution),
            pixel_weights=pixel_weights,
        )

    def record_gradients(
        self, centres: Float[Tensor, "m 2"], absolute: Float[Tensor, "m 2"] | None
    ) -> None:
        """Keep the pixel gradients of the ellipses' centres, and their sums of magnitudes."""
        if self.screen_gradient is not None:
            self.screen_gradient[self.rows] = (centres * self.half_size).norm(dim=1)
        if self.absgrad is not None and absolute is not None:
            self.absgrad[self.rows] = (absolute * self.half_size).norm(dim=1)

    def sum_weights(
        self, tiles: Int[Tensor, " t"], weights: Float[Tensor, "t s p"]
    ) -> Float[Tensor, "t s"]:
        """Sum blending weights over the pixels of ``tiles``, each times the pixel's weight."""
        if self.pixel_weights is not None:
            weights = weights * self.pixel_weights[tiles, None]
        return weights.sum(2)

    def record_contribution(self, weights: Float[Tensor, " m"]) -> None:
        """Keep each ellipse's sum of weights."""
        if self.contribution is not None:
            self.contribution[self.rows] = weights


@dataclass(frozen=True)
class TileBuffer:
    """Pairs, pixels and cut-offs of one image, blended in chunks of tiles."""

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
