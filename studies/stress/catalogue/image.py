"""Image: sizes of every kind, none or one splat, and pictures that nothing touches."""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.studies.stress.case import Change, Drawing, StressCase
from gsfw.studies.stress.catalogue.camera import camera_with
from gsfw.studies.stress.catalogue.variants import EVERYTHING, ordinary, splat_cases
from gsfw.studies.stress.scene import front_camera, random_splats


def _some(splats: Splats, count: int) -> Splats:
    colors = splats.means[:count, :1]
    return Splats(
        splats.means[:count],
        splats.opacities[:count],
        colors.abs(),
        quats=splats.means.new_ones(count, 4),
        scales=splats.means[:count].abs(),
    )


CHANGES: dict[str, Change] = {
    "image/one-splat": lambda splats: _some(splats, 1),
    "image/no-splat": lambda splats: _some(splats, 0),
}

SIZES = ((1, 1), (1, 4096), (4096, 1), (17, 31), (8, 8), (9, 7), (16, 16), (64, 48))
FAR_PIXELS = "thousands of pixels from the corner float32 places a splat to a ten-thousandth of one"
COUNTS = {"": 20, "/one-splat": 1, "/no-splat": 0}


def _sized(width: int, height: int, count: int) -> StressCase:
    kind = next(name for name, found in COUNTS.items() if found == count)

    def make() -> Drawing:
        camera = camera_with(3.0)(front_camera(width, height))
        settings = replace(EVERYTHING, depth=Depth.EXPECTED)
        return Drawing(random_splats(count), camera, settings)

    far = FAR_PIXELS if max(width, height) > 1000 else ""
    return StressCase(f"image/{width}x{height}{kind}", make, conditioning=far)


def _wide() -> Drawing:
    """1,024 columns of tiles: more than strips or blocks that are looked at together."""
    camera = front_camera(16384, 64)
    k = camera.intrinsics.clone()
    k[0, 0, 0], k[0, 1, 1] = 12000.0, 60.0
    return Drawing(ordinary(), replace(camera, intrinsics=k), replace(EVERYTHING, near=0.01))


def _untouched() -> Drawing:
    splats, background = ordinary(), torch.tensor([-0.5, 0.25, 2.0])
    away = replace(splats, means=splats.means + torch.tensor([1000.0, 0, 0]))
    settings = RenderSettings(
        background=background, depth=Depth.EXPECTED, statistics=frozenset(Statistic)
    )
    return Drawing(away, front_camera(), settings)


IMAGE = (
    *splat_cases(CHANGES, {}),
    *(_sized(*size, count) for size in SIZES for count in COUNTS.values()),
    StressCase("image/16384x64", _wide, conditioning=FAR_PIXELS),
    StressCase("image/untouched", _untouched),
)
"""All cases of this section."""
