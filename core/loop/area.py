"""Area filter over batches: each pixel of a smaller image is the mean of the area it covers."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.batch import LEAST_KNOWN, Batch, Resampling, ViewMap

WHOLE = 1 - 1e-4
"""Threshold of a full mean: a mean of ones is above this despite rounding."""


def shrink_batch(batch: Batch, width: int, height: int) -> Batch:
    """The same images at a smaller size; over any background they are the means of the large ones.

    Colours are averaged by their coverage. A pixel is valid if all pixels that it covers are. Maps
    follow their rules, and are unknown where a pixel is not valid. A mask that means "empty"
    becomes alpha, because a pixel may lie partly in it. Sizes need not divide; cameras follow by
    the exact ratio.

    Args:
        batch: ``c`` images of [h, w].
        width: width of the result, in pixels; at most ``w``.
        height: height of the result, in pixels; at most ``h``.
    """
    if batch.images.shape[1:3] == (height, width):
        return batch
    images, coverage, valid = batch.images, batch.coverage, batch.valid
    if coverage is None:
        images = area_means(images, width, height)
    else:
        weighted = torch.cat([images * coverage, coverage], dim=-1)
        images, coverage = _weighted_means(weighted, width, height)
    if valid is not None:
        valid = area_means(valid.to(images.dtype), width, height) > WHOLE
    return replace(
        batch,
        images=images,
        cameras=batch.cameras.resized(width, height),
        alpha=coverage,
        mask=valid,
        maps={name: _shrink_map(item, valid, width, height) for name, item in batch.maps.items()},
    )


def _shrink_map(
    given: ViewMap, valid: Bool[Tensor, "c h2 w2 1"] | None, width: int, height: int
) -> ViewMap:
    """Shrink a per-view map by its rule."""
    if given.rule is Resampling.NEAREST:
        rows, columns = given.values.shape[1:3]
        y, x = (
            ((torch.arange(small, device=given.values.device) + 0.5) * size / small).long()
            for size, small in ((rows, height), (columns, width))
        )
        values, known = given.values[:, y[:, None], x], given.known[:, y[:, None], x]
    else:
        weights = given.known.to(given.values.dtype)
        weighted = torch.cat([given.values * weights, weights], dim=-1)
        values, part = _weighted_means(weighted, width, height)
        known = part > LEAST_KNOWN - (1 - WHOLE)
    known = known if valid is None else known & valid
    return ViewMap(values * known, known, given.rule)


def _weighted_means(
    weighted: Float[Tensor, "c h w e"], width: int, height: int
) -> tuple[Float[Tensor, "c h2 w2 d"], Float[Tensor, "c h2 w2 1"]]:
    """Means of values by their weights, 0 where all weights are, and the means of the weights.

    Args:
        weighted: values times weights, then the weights as the last channel (e = d + 1).
        width: width of the result.
        height: height of the result.
    """
    means = area_means(weighted, width, height)
    values, weights = means[..., :-1], means[..., -1:]
    return values / torch.where(weights > 0, weights, 1.0), weights


def area_means(
    values: Float[Tensor, "c h w d"], width: int, height: int
) -> Float[Tensor, "c h2 w2 d"]:
    """Means over the areas of the pixels of a ``height`` x ``width`` image."""
    count, rows, columns, channels = values.shape
    values = _shrink_rows(values.reshape(count, rows, columns * channels), height)
    values = values.view(count, height, columns, channels).transpose(1, 2)
    values = _shrink_rows(values.reshape(count, columns, height * channels), width)
    return values.view(count, width, height, channels).transpose(1, 2).contiguous()


def _shrink_rows(values: Float[Tensor, "c r m"], smaller: int) -> Float[Tensor, "c s m"]:
    """Means of neighbouring rows: a weighted sum, which torch calls a bag of embeddings."""
    count, rows, length = values.shape
    covered, shares = _cover(rows, smaller, values.dtype, values.device)
    first_rows = torch.arange(count, device=values.device)[:, None, None] * rows
    means: Tensor = torch.nn.functional.embedding_bag(
        (first_rows + covered).flatten(0, 1),
        values.reshape(count * rows, length),
        per_sample_weights=shares.repeat(count, 1),
        mode="sum",
    )
    return means.view(count, smaller, length)


@lru_cache(maxsize=64)
def _cover(
    size: int, smaller: int, dtype: torch.dtype, device: torch.device
) -> tuple[Int[Tensor, "smaller taps"], Float[Tensor, "smaller taps"]]:
    """Source pixels of each of ``smaller`` equal parts of a row, and their shares of it.

    Kept on the device: the host would wait for a copy in every step.
    """
    edges = torch.linspace(0, size, smaller + 1, dtype=torch.float64)
    first = edges[:-1].floor().long()
    taps = int((edges[1:].ceil().long() - first).max())
    pixels = first[:, None] + torch.arange(taps)
    overlap = torch.minimum(pixels + 1.0, edges[1:, None]) - torch.maximum(
        pixels.double(), edges[:-1, None]
    )
    shares = overlap.clamp(min=0) * smaller / size
    return pixels.clamp(max=size - 1).to(device), shares.to(device, dtype)
