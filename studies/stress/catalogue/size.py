"""Size: pictures that need more than a machine has, and are to say so before they take it."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.cameras import CameraModel
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Drawing, StressCase
from gsfw.studies.stress.scene import front_camera

WIDTH = 2**20
"""Of a picture one tile high, so that it is small itself, and has 65,536 tiles of 16 pixels."""


def _covering(count: int) -> Drawing:
    """So many splats, each of which reaches every tile."""
    splats = Splats(
        means=torch.zeros(count, 3),
        opacities=torch.full((count,), 0.5),
        colors=torch.ones(count, 1),
        quats=torch.ones(count, 4),
        scales=torch.full((count, 3), 1e6),
    )
    camera = replace(front_camera(WIDTH, 16), model=CameraModel.ORTHOGRAPHIC)
    k = camera.intrinsics.clone()
    k[0, 0, 0], k[0, 1, 1] = 100.0, 100.0
    settings = RenderSettings(validation=Validation.CHEAP)
    return Drawing(splats, replace(camera, intrinsics=k), settings)


SIZE = (
    StressCase(
        "size/more-pairs-than-memory",
        lambda: _covering(5000),
        refusal=("bytes", "pairs"),
        refused_number=2**31,
    ),
    # 33,000 x 65,536 is above 2^31: in 32 bits with a sign it is negative, and passes any limit.
    # With tiles of 8 pixels it is four times that, of which 32 bits keep 60,817,408.
    StressCase(
        "size/more-pairs-than-int32",
        lambda: _covering(33_000),
        refusal=("bytes", "pairs"),
        refused_number=2**31,
    ),
)
"""All cases of this section."""
