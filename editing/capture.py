"""Capture: the cameras that saw the splats, and contributions to their views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import spread
from gsfw.core.maths.similarity import Similarity
from gsfw.core.progress import tracked
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats

MOST_VIEWS = 100
"""Most views that are rendered, spread evenly over all; it bounds the time."""
SEEN = 0.1
"""Pixels, weighted by alpha times transmittance, from which on a view counts as seeing a splat."""


@dataclass(frozen=True)
class Capture:
    """Cameras in the scene frame, and what renders for them."""

    cameras: tuple[Cameras, ...]
    """One each (c = 1)."""
    world_from_scene: Similarity
    """To the world as it was before any edit."""
    rasterizer: Rasterizer
    settings: RenderSettings
    device: torch.device
    source: str
    """Origin of the cameras, for messages."""
    invented: bool = False
    """True if nobody stood there: they surround a file of splats."""

    def sampled(self) -> Sequence[Cameras]:
        """At most ``MOST_VIEWS`` cameras."""
        chosen = spread(range(len(self.cameras)), MOST_VIEWS)
        return [self.cameras[index] for index in chosen]


@dataclass(frozen=True)
class Shares:
    """Contributions of each row to the views."""

    total: Float[Tensor, " n"]
    """Sum over views and pixels of alpha times transmittance."""
    views: Int[Tensor, " n"]
    """Number of views that see it: of at least ``SEEN`` pixels."""


@torch.no_grad()
def shares(
    capture: Capture, splats_at: Callable[[Float[Tensor, ""] | None], Splats], num_rows: int
) -> Shares:
    """Render all views without colours, each at its time, and sum what each row adds to them.

    Args:
        capture: cameras and rasterizer.
        splats_at: the splats at a time, in the scene frame, on the device of the capture.
        num_rows: number of rows; splats of some times may be fewer.
    """
    total = torch.zeros(num_rows, dtype=torch.float64)
    views = torch.zeros(num_rows, dtype=torch.int64)
    for camera in tracked(capture.sampled(), "measuring contributions", len(capture.sampled())):
        seen = camera.to(capture.device)
        splats = splats_at(None if seen.time is None else seen.time[0])
        added = capture.rasterizer.contributions(splats, seen, settings=capture.settings)
        added = added.sum(0).double().cpu()
        rows = slice(None) if splats.rows is None else splats.rows.cpu()
        total[rows] += added
        views[rows] += (added >= SEEN).long()
    return Shares(total, views)


def most_useful(scores: Float[Tensor, " n"], count: int) -> Int[Tensor, " m"]:
    """The rows of the highest scores, in their order; of equal ones the first."""
    return scores.argsort(descending=True, stable=True)[:count].sort().values


def row_mask(rows: Int[Tensor, " m"], count: int) -> Bool[Tensor, " n"]:
    """True for some of ``count`` rows."""
    return torch.zeros(count, dtype=torch.bool).index_fill(0, rows, True)
