"""Views that strategies with a budget look at."""

from dataclasses import replace

import torch

from gsfw.core.context import StepContext
from gsfw.core.render_output import RenderStatistics
from support.gaussians import context_of
from support.scenes import random_splats


def look(
    contribution, views=(0,), step=0, steps=100, loss=0.0, rows=None, num_rows=None
) -> tuple[StepContext, RenderStatistics]:
    """A batch of ``views`` in which splats had these contributions, in pixels of 3 x 2 images."""
    values = torch.tensor(contribution).reshape(len(views), -1)
    seen = RenderStatistics(
        values > 0, values, screen_gradient=torch.zeros_like(values), contribution=values
    )
    splats = random_splats(values.shape[1])
    if rows is not None:
        splats = replace(splats, rows=torch.tensor(rows))
    context = context_of(seen, num_rows or values.shape[1], step, splats=splats)
    batch = replace(context.batch, views=tuple(views))
    return replace(context, batch=batch, steps=steps, target=context.rendered.color + loss), seen
