"""Distractors: the parts of a photo that other photos of a still scene contradict.

Trimmed residuals, as in Sabour et al. 2023 (RobustNeRF, section 4): a pixel counts as a distractor
if its neighbourhood disagrees too. Differences: residuals are signed and averaged over cells, so
that fine detail that is not learnt yet cancels; their scale is that of the image itself, so that no
state is kept; and some steps use whole images. Without those, surfaces that no splats show yet
would be left out of all images, and never be learnt (Sabour et al. 2024, SpotLessSplats, draw from
masks for the same reason).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # Its parts are loaded when they are first used.
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, max_pool2d

from gsfw.core.batch import Batch
from gsfw.core.render_output import RenderOutput

CELLS = 48
"""Cells along the shorter side of an image: a distractor has at least a few of them."""
USUAL = 5.0
"""Multiple of the median difference of an image's cells above which a cell disagrees; cells without
valid pixels are not among them. Those of the empty space of cut-outs are: without them the gain on
the built-in scene with 30 % distractors fell from 2.0 to 1.5 dB (``benchmarks/distractors.py``)."""
LEAST = 0.12
"""Mean difference of colours in [0, 1] below which no cell disagrees: less than this may be light
or a reflection, and faint distractors do little harm."""
MOST = 0.4
"""Largest part of an image that starts a distractor."""
MAJORITY = 0.4
"""Part of the 3 x 3 cells around a cell that has to disagree with it."""
EDGE = 0.5
"""Part of the threshold from which on cells beside a distractor belong to it."""
COVERED = 0.9
"""Opacity of a render below which an opaque image is not contradicted, but not learnt yet."""
LARGE, STRONG = 0.02, 0.2
"""Part of an image, and mean difference of its colours in [0, 1], from which on one region shows
that something moved. Measured in docs/results/findings.md."""
WHOLE = 0.3
"""Part of the steps that use whole images. With less, surfaces that no splats show yet take too
long, and clean captures lose quality (``benchmarks/distractors.py --shares 0``)."""
KEPT_PSNR = "kept_psnr"
"""PSNR of a held-out image over the pixels that would be kept of a training image; with trained
exposures, which held-out images lack, of a render whose colours are fitted to its photo first."""
PROTOCOL = {
    "distractors": "not sought in psnr and ssim, which count held-out images whole",
    KEPT_PSNR: "as psnr (with exposure=true as color_corrected_psnr), of the pixels that "
    "ignore_distractors=true would keep of a training image",
    "training_psnr": "as psnr, of the pixels of some training images that are kept",
}
"""Definitions of the figures of a run that leaves distractors out."""
GOLDEN = 0.6180339887498949
"""Multiples of this are spread evenly between integers, whatever the order of the views."""


@dataclass(frozen=True)
class Distractors:
    """Finds distractors; the same step and images give the same ones."""

    start: int
    """Steps in which splats learn the scene from whole images first."""

    def are_left_out(self, step: int) -> bool:
        """True if ``step``, counted from 0, leaves distractors out."""
        return step >= self.start and step * GOLDEN % 1.0 >= WHOLE

    def without(
        self, batch: Batch, rendered: RenderOutput, target: Float[Tensor, "c h w 3"]
    ) -> Batch:
        """The batch with its distractors left out, of the per-view maps too.

        Args:
            batch: images of any split.
            rendered: the scene, with the exposures of the images if they are known.
            target: the images, over the same background.
        """
        counted = comparable(rendered.alpha, batch.coverage, batch.valid)
        left_out = self.found(rendered.color, target, counted, batch.valid)
        maps = {name: item.within(~left_out) for name, item in batch.maps.items()}
        return replace(batch, left_out=left_out, maps=maps)

    def without_some(
        self, batch: Batch, rendered: RenderOutput, target: Float[Tensor, "1 h w 3"]
    ) -> Batch:
        """As ``without``, for figures: the batch itself if more than ``MOST`` would be left out.

        So a wrong model has no good figures of the few pixels that it has right. Empty space of a
        cut-out is no part of it. Synchronises.
        """
        found, content = self.without(batch, rendered, target), batch.valid
        if batch.coverage is not None:
            content = (batch.coverage > 0) | (rendered.alpha > COVERED)
            content = content if batch.valid is None else content & batch.valid
        assert found.left_out is not None
        left_out = found.left_out if content is None else found.left_out[content]
        return batch if left_out.sum() > MOST * left_out.numel() else found

    @torch.no_grad()
    def found(
        self,
        rendered: Float[Tensor, "c h w 3"],
        target: Float[Tensor, "c h w 3"],
        counted: Bool[Tensor, "c h w 1"] | None,
        valid: Bool[Tensor, "c h w 1"] | None = None,
    ) -> Bool[Tensor, "c h w 1"]:
        """True where an image shows a distractor; no synchronisation.

        Args:
            rendered: the scene.
            target: the images, over the same background.
            counted: pixels that can be compared; ``None``: all.
            valid: pixels whose cells give the usual difference and the limit; ``None``: all.
        """
        height, width = target.shape[1:3]
        cell = _cell_size(height, width)
        cells = _disagreeing(_differences(rendered, target, counted), _cells_with(valid))
        c, _, rows, columns = cells.shape
        spread = cells[:, 0, :, None, :, None, None].expand(c, rows, cell, columns, cell, 1)
        found = spread.reshape(c, rows * cell, columns * cell, 1)[:, :height, :width]
        return found if counted is None else found & counted


@torch.no_grad()
def is_contradicted(batch: Batch, rendered: RenderOutput, target: Float[Tensor, "1 h w 3"]) -> bool:
    """True if an image shows one large thing of other colours than the rest of the capture.

    Args:
        batch: the image.
        rendered: the trained scene from its camera.
        target: the image, over the same background.
    """
    # As of opaque images: what is not learnt yet would be a hole in the render of a cut-out.
    counted = comparable(rendered.alpha, None, batch.valid)
    differences = _differences(rendered.color, target, counted)
    regions = _disagreeing(differences, _cells_with(batch.valid))[0, 0].cpu().numpy()
    cells = differences.cpu().numpy().ravel()
    labels, count = scipy.ndimage.label(regions)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    if not count or sizes.max() < LARGE * cells.size:
        return False
    return bool(cells[labels.ravel() == sizes.argmax() + 1].mean() >= STRONG)


def _cell_size(height: int, width: int) -> int:
    """Side of a cell, in pixels."""
    return max(2, round(min(height, width) / CELLS))


def _differences(
    rendered: Float[Tensor, "c h w 3"],
    target: Float[Tensor, "c h w 3"],
    counted: Bool[Tensor, "c h w 1"] | None,
) -> Float[Tensor, "c 1 i j"]:
    """Absolute mean differences of the cells of images; pixels that do not count have none."""
    # Planes of one channel are masked and averaged faster than pixels of three.
    difference = (rendered - target).permute(0, 3, 1, 2).contiguous()
    if counted is not None:
        # Values that do not count may not be finite.
        difference = torch.where(counted.permute(0, 3, 1, 2), difference, 0.0)
    cell = _cell_size(*target.shape[1:3])
    means = avg_pool2d(difference, cell, cell, ceil_mode=True, count_include_pad=False)
    return means.abs().mean(1, keepdim=True)


def _cells_with(pixels: Bool[Tensor, "c h w 1"] | None) -> Bool[Tensor, "c 1 i j"] | None:
    """True for cells with any of the pixels; ``None``: all."""
    if pixels is None:
        return None
    planes = pixels.permute(0, 3, 1, 2).to(torch.float32)
    return max_pool2d(planes, _cell_size(*pixels.shape[1:3]), ceil_mode=True) > 0


def _disagreeing(
    cells: Float[Tensor, "c 1 i j"], judging: Bool[Tensor, "c 1 i j"] | None
) -> Bool[Tensor, "c 1 i j"]:
    """True for groups of cells whose differences are far above the usual one of their image."""
    judged = cells if judging is None else cells.masked_fill(~judging, torch.nan)
    ordered = judged.flatten(1).sort(dim=1).values
    last = ((~ordered.isnan()).sum(1, keepdim=True) - 1).clamp(min=0)  # Those of NaN follow.
    usual = ordered.gather(1, last // 2)
    most = ordered.gather(1, ((1 - MOST) * last.double()).long())
    above = (USUAL * usual).clamp(min=LEAST).maximum(most)[..., None, None]
    alone = (cells > above).to(cells.dtype)
    grouped = alone * (avg_pool2d(alone, 3, 1, 1) > MAJORITY)
    beside = (max_pool2d(grouped, 3, 1, 1) > 0) & (cells > EDGE * above)
    return (grouped > 0) | beside


def comparable(
    alpha: Float[Tensor, "c h w 1"],
    coverage: Float[Tensor, "c h w 1"] | None,
    valid: Bool[Tensor, "c h w 1"] | None,
) -> Bool[Tensor, "c h w 1"] | None:
    """Pixels whose image and render can contradict each other; ``None``: all.

    Args:
        alpha: of the render.
        coverage: of the images; ``None`` if they are opaque.
        valid: pixels that carry loss; ``None``: all.
    """
    if coverage is not None:  # Empty space of such images has a colour too: the background's.
        return valid
    covered = alpha.detach() > COVERED
    return covered if valid is None else covered & valid
