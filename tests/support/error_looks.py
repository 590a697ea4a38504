"""Views with errors at some pixels, each of which shows a single splat."""

from dataclasses import replace

import torch

from gsfw.core.batch import MaskMode
from gsfw.core.context import StepContext
from gsfw.core.render_output import RenderStatistics
from support.gaussians import context_of
from support.scenes import random_splats

PIXELS = 6
"""Of images of 3 x 2 pixels."""


def error_look(
    errors, shown, views=(0,), step=0, rows=None, num_rows=None, valid=None, gradient=None
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
    """
    wrong = torch.tensor(errors).reshape(len(views), 2, 3, 1)
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
    mask = None if valid is None else torch.tensor(valid).reshape(len(views), 2, 3, 1)
    batch = replace(context.batch, views=tuple(views), mask=mask, mask_mode=MaskMode.IGNORE)

    def contributions(weights):
        return weights.reshape(len(views), PIXELS) @ owned

    target = context.rendered.color + wrong
    return replace(context, batch=batch, target=target, contributions=contributions), seen
