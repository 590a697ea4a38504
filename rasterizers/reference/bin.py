"""Bin: which ellipse meets which tile, exactly.

An ellipse cut by a row of tiles spans an interval of x; a tile of that row is met if and only if it
overlaps the interval, because the cut is convex. The published code takes the square around the
ellipse instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import embedding_bag

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.maths.ragged import row_offsets, value_indices, value_rows
from gsfw.core.numerics import NumericsProfile
from gsfw.rasterizers.reference.project import Ellipses, reach

TILE = 8
"""Side of a tile in pixels: of 8 and 16 the faster on small images, measured on two CPU cores."""

PIXELS = TILE * TILE

SLACK = 1e-3
"""Pixels, and 1/100 of it per pixel of extent, by which rounding may not shrink an ellipse."""

PAIR_BYTES = 64
"""Memory per pair while binning: eight 64-bit numbers."""


@dataclass(frozen=True)
class Bins:
    """The (ellipse, tile) pairs of one image: tile after tile, in each from front to back."""

    columns: int
    """Tiles per row of tiles."""
    middles: Float[Tensor, "t 2"]
    """Middle of each tile, in pixels."""
    starts: Int[Tensor, " t"]
    """First pair of each tile."""
    counts: Int[Tensor, " t"]
    """Pairs of each tile."""
    ellipses: Int[Tensor, " p_plus_1"]
    """The ellipse of each pair; the last element is the number of ellipses, an ellipse that is
    not there: pair -1 stands for an empty slot."""
    by_ellipse: Int[Tensor, " p"]
    """The pairs, ellipse after ellipse."""
    ellipse_starts: Int[Tensor, " m_plus_1"]
    """Start of each ellipse's pairs in ``by_ellipse``, then the number of pairs."""

    def inside(self, camera: Cameras) -> Float[Tensor, "t pixels"]:
        """1 for the pixels of the camera's image, 0 for what tiles have beyond it."""
        steps = torch.arange(TILE, device=self.middles.device) - 0.5 * (TILE - 1)
        size = self.middles.new_tensor([camera.width, camera.height])
        x, y = ((self.middles[:, :, None] + steps) < size[:, None]).unbind(1)
        return (y[:, :, None] & x[:, None, :]).flatten(1).to(self.middles.dtype)

    def by_tile(self, image: Float[Tensor, "h w"]) -> Float[Tensor, "t pixels"]:
        """Cut an image into its tiles, with zeros for what tiles have beyond it."""
        height, width = image.shape
        rows = len(self.middles) // self.columns
        padded = image.new_zeros(rows * TILE, self.columns * TILE)
        padded[:height, :width] = image
        tiles = padded.view(rows, TILE, self.columns, TILE).transpose(1, 2)
        return tiles.reshape(len(self.middles), PIXELS)

    def sum_by_ellipse(self, values: Float[Tensor, "p_plus_1 f"]) -> Float[Tensor, "m f"]:
        """Sum the rows of each ellipse's pairs, always in the same order."""
        return embedding_bag(
            self.by_ellipse, values, self.ellipse_starts, mode="sum", include_last_offset=True
        )


def bin_ellipses(
    ellipses: Ellipses, camera: Cameras, profile: NumericsProfile, pairs_mb: float
) -> Bins:
    """Sort ellipses, given from front to back, into tiles.

    Raises:
        ConfigError: the pairs would take more than ``pairs_mb`` megabytes.
    """
    columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
    device = ellipses.means.device
    if profile.alpha_min > 0:
        members, tiles = _intersections(ellipses, reach(ellipses, profile), columns, rows, pairs_mb)
    else:
        _check_memory(len(ellipses.means) * columns * rows, pairs_mb)
        everyone = torch.arange(len(ellipses.means), device=device)
        members = everyone.repeat_interleave(columns * rows)
        tiles = torch.arange(columns * rows, device=device).repeat(len(everyone))
    # Pairs come ellipse after ellipse, from front to back; a stable sort keeps this in a tile.
    sorted_tiles, order = tiles.sort(stable=True)
    counts = sorted_tiles.bincount(minlength=columns * rows)
    by_ellipse = torch.empty_like(order)
    by_ellipse[order] = torch.arange(len(order), device=device)
    numbers = torch.arange(columns * rows, device=device)
    middles = (torch.stack([numbers % columns, numbers // columns], dim=1) + 0.5) * TILE
    absent = members.new_full((1,), len(ellipses.means))
    return Bins(
        columns=columns,
        middles=middles.to(ellipses.means.dtype),
        starts=counts.cumsum(0) - counts,
        counts=counts,
        ellipses=torch.cat([members[order], absent]),
        by_ellipse=by_ellipse,
        ellipse_starts=row_offsets(members.bincount(minlength=len(ellipses.means))),
    )


def _check_memory(pairs: int, pairs_mb: float) -> None:
    if pairs * PAIR_BYTES > pairs_mb * 2**20:
        raise ConfigError(
            f"this image needs {pairs * PAIR_BYTES} bytes for {pairs} pairs of a splat and a "
            f"tile that it reaches; rasterizer.pairs_mb={pairs_mb:g} does not allow that.",
            "Render a smaller image, keep splats from growing this large, or raise the limit.",
        )


def _intersections(
    ellipses: Ellipses, reaches: Float[Tensor, " m"], columns: int, rows: int, pairs_mb: float
) -> tuple[Int[Tensor, " p"], Int[Tensor, " p"]]:
    """All pairs of an ellipse and a tile that meet, ellipse after ellipse."""
    (x, y), (xx, xy, yy) = ellipses.means.unbind(1), ellipses.covariances.unbind(1)
    height = (reaches * yy).sqrt()
    owner, row = _expand(y - height, y + height, height, rows, pairs_mb)
    # From here on one element is one ellipse in one row of tiles.
    per_ellipse = [x, y, height, xy / yy, xy * (reaches / xx).sqrt()]
    per_ellipse += [(reaches * xx).sqrt(), (ellipses.determinants / yy).sqrt(), reaches, yy]
    x, y, height, tilt, turn, width, narrow, reaches, yy = (
        torch.stack(per_ellipse, dim=1).index_select(0, owner).unbind(1)
    )
    top = row * TILE + 0.5 - y
    # Within a row the ellipse is widest where it turns, or else at the nearer edge of the row.
    low, high = top.clamp(-height, height), (top + (TILE - 1)).clamp(-height, height)
    at_right, at_left = turn.clamp(low, high), (-turn).clamp(low, high)
    right = tilt * at_right + narrow * (reaches - at_right.square() / yy).clamp(min=0).sqrt()
    left = tilt * at_left - narrow * (reaches - at_left.square() / yy).clamp(min=0).sqrt()
    which, column = _expand(x + left, x + right, width, columns, pairs_mb)
    return owner[which], row[which] * columns + column


def _expand(
    low: Float[Tensor, " m"],
    high: Float[Tensor, " m"],
    extents: Float[Tensor, " m"],
    tiles: int,
    pairs_mb: float,
) -> tuple[Int[Tensor, " p"], Int[Tensor, " p"]]:
    """One element per interval [low, high] and tile along one axis that has a pixel centre in it.

    Returns:
        The interval and the tile of each.
    """
    slack = SLACK + 0.01 * SLACK * extents
    # Clamped before they become integers, which hold no infinity.
    first = ((low - slack - (TILE - 0.5)) / TILE).ceil().clamp(0, tiles).long()
    last = ((high + slack - 0.5) / TILE).floor().clamp(-1, tiles - 1).long()
    counts = (last - first + 1).clamp(min=0)
    _check_memory(int(counts.sum()), pairs_mb)
    return value_rows(counts), value_indices(first, counts)
