"""Contributions: what each Gaussian adds to views, its blending weights summed over their pixels.

One backend measures one view (``Rasterizer.contributions``); here are the sums over views.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature, Needs
from gsfw.core.datamanager import spread
from gsfw.core.errors import ConfigError
from gsfw.core.progress import tracked
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats

MEASURES = Needs(features=frozenset({Feature.CONTRIBUTION}))
"""The need of a rasterizer that measures contributions."""
SEEN = 0.1
"""Pixels, weighted by alpha times transmittance, from which on a view counts as seeing a splat."""


SplatsAt = Callable[[Float[Tensor, ""] | None, Cameras], Splats]
"""Splats at a time in [0, 1], or ``None``, for one camera: ``PrimitiveModel.splats``, or alike."""


class NoRowsError(ConfigError):
    """The splats of a view are no rows of the model, such as a cut of its tree."""


@dataclass(frozen=True)
class Contributions:
    """Contributions of each row to some views, on the CPU."""

    total: Float[Tensor, " n"]
    """Sum over views and pixels of alpha times transmittance, in float64."""
    views: Int[Tensor, " n"]
    """Number of views that see it: of at least ``SEEN`` pixels."""

    @staticmethod
    @torch.no_grad()
    def of(
        splats_at: SplatsAt,
        num_rows: int,
        cameras: Sequence[Cameras],
        rasterizer: Rasterizer,
        settings: RenderSettings,
        most: int = 0,
    ) -> Contributions:
        """Render views without colours, each at its time, and sum what each row adds to them.

        Args:
            splats_at: the splats in the scene frame; they are rendered in float32.
            num_rows: number of rows; splats of some times may be fewer.
            cameras: one for each view, on the device of the splats.
            rasterizer: measures contributions.
            settings: of the render.
            most: most views that are rendered, spread evenly over all, which bounds the time; 0
                for all.

        Raises:
            NoRowsError: the splats of a view do not name their rows, and are not all of them.
        """
        total = torch.zeros(num_rows, dtype=torch.float64)
        views = torch.zeros(num_rows, dtype=torch.int64)
        chosen = spread(range(len(cameras)), most)
        for index in tracked(chosen, "measuring what each Gaussian adds to views", len(chosen)):
            seen = cameras[index].to(dtype=torch.float32)
            splats = splats_at(None if seen.time is None else seen.time[0], seen)
            if splats.rows is None and len(splats) != num_rows:
                raise NoRowsError(
                    f"contributions: a view shows {len(splats)} splats of a model of {num_rows} "
                    "Gaussians, and they do not name their rows.",
                    "Return Splats(..., rows=rows) from splats() of the model.",
                )
            splats = splats.map(lambda tensor: tensor.detach().float())
            added = rasterizer.contributions(splats, seen, settings=settings)
            added = added.sum(0).double().cpu()
            rows = slice(None) if splats.rows is None else splats.rows.cpu()
            total[rows] += added
            views[rows] += (added >= SEEN).long()
        return Contributions(total, views)


def most_useful(scores: Float[Tensor, " n"], count: int) -> Int[Tensor, " m"]:
    """The rows of the highest scores, in their order; of equal ones the first."""
    return scores.argsort(descending=True, stable=True)[:count].sort().values


def most_useful_part(scores: Float[Tensor, " n"], part: float) -> Int[Tensor, " m"]:
    """The rows of the highest scores, in their order; of equal ones the first.

    Args:
        scores: of each row.
        part: of all rows, in (0, 1]; at least one row is kept.
    """
    return most_useful(scores, max(1, round(part * len(scores))))
