"""Views with errors at some pixels, each of which shows a single splat."""

from dataclasses import replace

import torch

from gsfw.core.batch import MaskMode
from gsfw.core.context import StepContext
from gsfw.core.render_output import RenderStatistics
from support.gaussians import context_of
from support.scenes import random_splats

WIDTH, HEIGHT = 3, 2
PIXELS = WIDTH * HEIGHT
"""Of an image, unless another height is given."""


def error_look(
    errors,
    shown,
    views=(0,),
    step=0,
    rows=None,
    num_rows=None,
    valid=None,
    gradient=None,
    height=HEIGHT,
) -> tuple[StepContext, RenderStatistics]:
    """A batch of ``views`` whose renders have these errors.

    Args:
        errors: of each pixel, view by view.
        shown: the splat that each pixel shows.
        views: the views of the batch.
        step: of the run.
        rows: the row of each splat; ``None`` when splat i is row i.
        num_rows: of the model; as many as there are splats if ``None``.
        valid: whether each pixel is valid; ``None`` when all are.
        gradient: screen gradient of each splat; ones if ``None``.
        height: of the images in pixels.
    """
    shape = (len(views), height, WIDTH, 1)
    wrong = torch.tensor(errors).reshape(shape)
    owned = torch.nn.functional.one_hot(torch.tensor(shown)).float()
    count = owned.shape[1]
    seen = RenderStatistics(
        torch.ones(len(views), count, dtype=torch.bool),
        torch.ones(len(views), count),
        torch.ones(len(views), count) if gradient is None else torch.tensor([gradient]),
    )
    splats = random_splats(count)
    if rows is not None:
        splats = replace(splats, rows=torch.tensor(rows))
    context = context_of(seen, num_rows or count, step, splats=splats)
    mask = None if valid is None else torch.tensor(valid).reshape(shape)
    batch = replace(context.batch, views=tuple(views), mask=mask, mask_mode=MaskMode.IGNORE)

    def contributions(weights):
        return weights.reshape(len(views), -1) @ owned

    color, alpha = (
        image[:, :1, :1].expand(*shape[:3], -1)
        for image in (context.rendered.color, context.rendered.alpha)
    )
    rendered = replace(context.rendered, color=color, alpha=alpha)
    changed = replace(context, batch=batch, rendered=rendered, target=color + wrong)
    return replace(changed, contributions=contributions), seen
