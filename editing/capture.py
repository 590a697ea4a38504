"""Capture: the cameras that saw the splats, and contributions to their views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import spread
from gsfw.core.loop.contributions import view_contributions
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
    cameras = tracked(capture.sampled(), "measuring contributions", len(capture.sampled()))
    seen = (camera.to(capture.device) for camera in cameras)
    for added in view_contributions(
        seen, splats_at, capture.rasterizer, capture.settings, num_rows
    ):
        total += added
        views += (added >= SEEN).long()
    return Shares(total, views)


def row_mask(rows: Int[Tensor, " m"], count: int) -> Bool[Tensor, " n"]:
    """True for some of ``count`` rows."""
    return torch.zeros(count, dtype=torch.bool).index_fill(0, rows, True)
