"""Scene: random splats that fill a picture as those of a trained scene do."""

from __future__ import annotations

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.splats import Splats
from gsfw.studies.bench.workload import Workload

SPLATS, WIDTH, HEIGHT = 100_000, 640, 420
"""Of the built-in workload."""
FOCAL = 0.75
"""In widths of the picture."""
NEAREST, FURTHEST = 1.2, 3.2
"""View depths."""
SPREAD = 1.25
"""How far splats reach beyond the picture, whose edges are at 1: a third is unseen."""
SMALLEST_SCALE, LARGEST_SCALE = 1e-4, 0.02
"""Standard deviations of 100,000 splats, in scene units: up to 3 pixels far, 8 pixels near."""
SEED = 42

RANDOM = "random:"
"""What a workload begins with that is made for a number of splats."""
FULL_HD = (1920, 1080)


def scattered(
    count: int, width: int, height: int, device: torch.device, seed: int = SEED
) -> tuple[Splats, Cameras]:
    """Random splats in front of one camera, and a margin beyond; of a seed always the same.

    Sizes and opacities are distributed as in the workload "garden" of docs/performance.md. More
    splats are smaller, by the square root of their number, so that 50 to 62 of them contribute to
    each pixel, be they 100,000 or 5,000,000, and however large the picture.
    """
    generator = torch.Generator(device).manual_seed(seed)

    def uniform(columns: int, low: float, high: float) -> Tensor:
        numbers = torch.rand(count, columns, generator=generator, device=device)
        return low + (high - low) * numbers

    focal = FOCAL * width
    shrink = (SPLATS / max(count, 1)) ** 0.5
    depth = uniform(1, NEAREST, FURTHEST)
    edges = 0.5 * SPREAD / focal * torch.tensor([width, height], device=device)
    splats = Splats(
        means=torch.cat([uniform(2, -1.0, 1.0) * edges * depth, depth], dim=1),
        quats=torch.randn(count, 4, generator=generator, device=device),
        scales=uniform(3, SMALLEST_SCALE * shrink, LARGEST_SCALE * shrink),
        opacities=uniform(1, 0.0, 1.0)[:, 0],
        colors=uniform(3, 0.0, 1.0),
    )
    intrinsics = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return splats, Cameras(torch.eye(4)[None], intrinsics[None], width, height).to(device)


def built_in(device: torch.device) -> Workload:
    """What is drawn where nothing is given: 13.4 million contributing pairs.

    Made on the CPU, so that it is the same on every device.
    """
    splats, cameras = scattered(SPLATS, WIDTH, HEIGHT, torch.device("cpu"))
    return Workload("built in", splats, cameras).to(device)


def random_workload(text: str, device: torch.device) -> Workload:
    """As many splats as ``random:COUNT`` says, at 1920x1080.

    Raises:
        ConfigError: that is no number of splats.
    """
    given = text.removeprefix(RANDOM)
    count = int(given) if given.isdecimal() else 0
    if not 1 <= count < 2**31:
        raise ConfigError(
            f"workload={text}: expected a number of splats after {RANDOM}, found {given!r}.",
            f"Write it in digits: workload={RANDOM}1000000",
        )
    return Workload(text, *scattered(count, *FULL_HD, device))
