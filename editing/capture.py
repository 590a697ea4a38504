"""Capture: the cameras that saw the splats, and what renders for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.contributions import Contributions, SplatsAt
from gsfw.core.datamanager import spread
from gsfw.core.maths.similarity import Similarity
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings

MOST_VIEWS = 100
"""Most views that are rendered, spread evenly over all; it bounds the time."""


@dataclass(frozen=True)
class Capture:
    """Cameras in the scene frame, and what renders for them."""

    cameras: tuple[Cameras, ...]
    """One each (c = 1)."""
    world_from_scene: Similarity
    """Similarity from the scene frame to the world as it was before any edit."""
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

    def contributions(self, splats_at: SplatsAt, num_rows: int) -> Contributions:
        """Contributions of each row to ``sampled`` views, each at its time.

        Args:
            splats_at: the splats in the scene frame, on the device.
            num_rows: number of rows; splats of some times may be fewer.
        """
        cameras = [camera.to(self.device) for camera in self.cameras]
        return Contributions.of(
            splats_at, num_rows, cameras, self.rasterizer, self.settings, most=MOST_VIEWS
        )


def row_mask(rows: Int[Tensor, " m"], count: int) -> Bool[Tensor, " n"]:
    """True for some of ``count`` rows."""
    return torch.zeros(count, dtype=torch.bool).index_fill(0, rows, True)
