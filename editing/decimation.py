"""Decimation: fewer splats that look nearly the same.

The splats that add least to the views are left out, pairs of the others are merged, and the
constant colours are refitted. Leaving out is best for a few, merging for many: how much is left out
first is tried, and the best by PSNR against the given splats is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.loop.contributions import highest_rows
from gsfw.core.splats import Sh
from gsfw.editing.capture import row_mask
from gsfw.editing.editable import EditableSplats
from gsfw.editing.editable_model import EditableModel
from gsfw.editing.merging import merged_down
from gsfw.editing.refit import Comparison, refitted

LEFT_OUT = (0.01, 0.03, 1.0)
"""Parts of all that is added to views, which may be left out before pairs are merged. At a half, a
quarter and a tenth of 7,568 splats of the built-in scene 0.01 gives 35.8, 27.7 and 23.0 dB before
refitting, 0.03 gives 36.5, 27.8 and 22.8, and 1 (no merging) 35.9, 22.3 and 16.1."""


@dataclass(frozen=True)
class Decimated:
    """Fewer splats."""

    piece: EditableSplats | EditableModel
    psnr: float
    """PSNR of their views against those of the given ones, in dB."""
    before_refit: float
    """The same with the colours as they were."""


def decimate(given: EditableSplats, count: int) -> Decimated:
    """Decimate to exactly ``count`` splats.

    Args:
        given: more splats than that.
        count: number of splats that are left, at least 1.
    """
    scores = given.shares().total
    comparison = Comparison.of(given.capture())
    targets = comparison.images(given.scene_splats())
    tried: list[tuple[float, EditableSplats]] = []
    for part in LEFT_OUT:
        smaller = _fewer(given, scores, count, part)
        tried.append((comparison.psnr(smaller.scene_splats(), targets), smaller))
    before, best = max(tried, key=lambda item: item[0])
    colors, fitted, psnr = best.splats().colors, *_refit(best, comparison, targets)
    if not psnr > before:  # Colours were clamped, so that the problem is not linear.
        return Decimated(best, before, before)
    assert isinstance(colors, Sh)
    dense = colors.dense().clone()
    # Rotations leave the constant coefficient as it is: it is the same in the scene frame.
    dense[:, 0] = fitted.to(dense)
    splats = replace(best.splats(), colors=Sh(dense, colors.degree))
    return Decimated(best.with_splats(splats), psnr, before)


def decimate_model(given: EditableModel, count: int) -> Decimated | None:
    """Leave out rows that add least, and refit the constant colours of a static model.

    ``None`` if its colours cannot be refitted; the rows are left out all the same.
    """
    rows = row_mask(highest_rows(given.shares().total, count), len(given))
    if not given.can_refit():
        given.keep(rows)
        return None
    comparison = Comparison.of(given.capture())
    targets = comparison.images(given.scene_splats())
    best = given.keep(rows)
    before = comparison.psnr(best.scene_splats(), targets)
    fitted, psnr = _refit(best, comparison, targets)
    if not psnr > before:
        return Decimated(best, before, before)
    return Decimated(best.with_constants(fitted), psnr, before)


def _refit(
    piece: EditableSplats | EditableModel,
    comparison: Comparison,
    targets: Sequence[Float[Tensor, "h w 3"]],
) -> tuple[Float[Tensor, "n 3"], float]:
    """Constant coefficients that are nearest to the images, and their PSNR."""
    fitted = refitted(piece.scene_splats(), comparison, targets, piece.shares().total)
    assert isinstance(fitted.colors, Sh)
    return fitted.colors.coefficients[:, 0], comparison.psnr(fitted, targets)


def _fewer(
    given: EditableSplats, scores: Float[Tensor, " n"], count: int, part: float
) -> EditableSplats:
    """Leave out the least useful splats, at most ``part`` of all contributions; merge the rest."""
    ordered = scores.sort().values
    below = int((ordered.cumsum(0) < part * ordered.sum()).sum())
    unused = min(below, len(given) - count)
    rows = highest_rows(scores, len(given) - unused)
    splats = given.splats().take(rows)
    if len(rows) > count:
        splats = merged_down(splats, scores[rows], count)
    return given.with_splats(splats)


def evenly(given: EditableSplats, count: int) -> EditableSplats:
    """Some of the splats, evenly over their rows: a sample for sizes of files."""
    rows = torch.linspace(0, len(given) - 1, count).round().long()
    return given.with_splats(given.splats().take(rows))
