"""Segmentation: which rows are foreground, learned from masks of the views.

Luiten et al. 2024, section 3.4. Each row has a logit that is rendered as one extra channel in the
same pass and compared with the masks. The released code takes it from the initial point cloud and
does not train it, and renders it in a second pass.
"""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.batch import SEGMENTATION, Batch
from gsfw.core.context import StepContext
from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError
from gsfw.core.maths.rotations import same_half
from gsfw.core.render_output import RenderOutput
from gsfw.methods.dynamic3d.trajectory import Pose

UNKNOWN = 0.5
"""Segmentation where no row is, and of rows at the start. Over 0, rows that have not learned their
segmentation yet would become transparent in front of the background (built-in moving scene, 32 x
24, 80 steps: 13.9 instead of 18.2 dB). The released code has a channel of the background instead.
"""


def has_masks(views: Views) -> bool:
    """True if the views have masks of the foreground.

    Raises:
        ConfigError: the map has more than one channel.
    """
    channels = views.maps.get(SEGMENTATION, 0)
    if channels > 1:
        raise ConfigError(
            f"the per-view map {SEGMENTATION!r} has {channels} channels, and method 'dynamic3dgs' "
            "expects one: 1 where the foreground is, else 0.",
            "Convert the masks to grey images or to .npy files of the shape [height, width, 1], or "
            "train without them: segmentation_weight=0.",
        )
    return channels == 1


def foreground(batch: Batch) -> Float[Tensor, "c h w 1"]:
    """Masks of the foreground in [0, 1]; images of 0 and 255 count as 0 and 1."""
    return batch.maps[SEGMENTATION].values.clamp(0.0, 1.0)


def mask_loss(context: StepContext, ssim_weight: float) -> Float[Tensor, ""]:
    """L1 and 1 - SSIM of the rendered segmentation over the known pixels of the masks.

    Both images are composited over ``UNKNOWN``.
    """
    batch, rendered = context.batch, context.rendered
    assert rendered.extra is not None
    known, mask = batch.maps[SEGMENTATION].known, foreground(batch)
    if batch.coverage is not None:
        mask = mask * batch.coverage + UNKNOWN * (1.0 - batch.coverage)
    l1, dssim = context.operators.l1_dssim(
        rendered.extra + UNKNOWN * (1.0 - rendered.alpha),
        mask,
        known if batch.valid is None else known & batch.valid,
    )
    return (1.0 - ssim_weight) * l1 + ssim_weight * dssim


def intersection_over_union(batch: Batch, rendered: RenderOutput) -> float:
    """Pixels in both foregrounds, rendered and true, by those in either; 1 if there are none."""
    assert rendered.extra is not None
    known = batch.maps[SEGMENTATION].known
    found, true = (rendered.extra > 0.5) & known, (foreground(batch) > 0.5) & known
    either = int((found | true).sum())
    return int((found & true).sum()) / either if either else 1.0


def background_change(
    background: Bool[Tensor, " n"], now: Pose, first: Pose, extent: float
) -> Float[Tensor, ""]:
    """Mean change of background rows: the L1 norm of positions in extents, and of quaternions."""
    quats = normalize(now.quats, dim=1)
    moved = (now.means - first.means).abs().sum(1) / extent
    turned = (quats - same_half(first.quats, quats)).abs().sum(1)
    return ((moved + turned) * background).sum() / background.sum().clamp(min=1)
