"""Contributions: what each row of a model adds to views, and the rows that add most."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats


def view_contributions(
    cameras: Iterable[Cameras],
    splats_at: Callable[[Float[Tensor, ""] | None], Splats],
    rasterizer: Rasterizer,
    settings: RenderSettings,
    num_rows: int,
) -> Iterator[Float[Tensor, " n"]]:
    """Render each view without colours, at its time, and sum what each row adds to its pixels.

    Yields alpha times transmittance, float64 on the CPU; 0 for rows that are absent at the time.

    Args:
        cameras: one each (c = 1), on the device of the splats.
        splats_at: the splats at a time, in the scene frame.
        rasterizer: measures contributions.
        settings: render settings.
        num_rows: number of rows; splats of some times may be fewer.
    """
    for camera in cameras:
        splats = splats_at(None if camera.time is None else camera.time[0])
        added = rasterizer.contributions(splats, camera, settings=settings).sum(0).double().cpu()
        if splats.rows is not None:
            absent = torch.zeros(num_rows, dtype=torch.float64)
            added = absent.index_copy(0, splats.rows.cpu(), added)
        yield added


def highest_rows(scores: Float[Tensor, " n"], count: int) -> Int[Tensor, " m"]:
    """The rows of the highest scores, in their order; of equal ones the first."""
    return scores.argsort(descending=True, stable=True)[:count].sort().values
