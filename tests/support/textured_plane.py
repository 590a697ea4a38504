"""Views of a plane with a smooth random texture, made exactly: each image is a shifted one."""

import torch
from torch.nn.functional import interpolate

from gsfw.core.stereo.views import StereoViews

DEPTH = 4.0
WIDTH, HEIGHT, FOCAL = 48, 36, 40.0


def views_of_a_plane(
    count: int = 3, step: float = 0.4, heights: tuple[int, ...] = ()
) -> StereoViews:
    """Cameras beside each other, ``step`` apart, that look along z at a plane at ``DEPTH``.

    ``heights`` cuts images at the bottom, so that their sizes differ.
    """
    poses = torch.eye(4, dtype=torch.float64).repeat(count, 1, 1)
    poses[:, 0, 3] = -step * torch.arange(count)
    intrinsics = torch.tensor([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    shifts = [round(step * i * FOCAL / DEPTH) for i in range(count)]
    generator = torch.Generator().manual_seed(0)
    coarse = torch.rand(1, 3, 18, 60, generator=generator)
    texture = interpolate(coarse, (HEIGHT, 120), mode="bilinear", align_corners=False)[0]
    rows = heights or (HEIGHT,) * count
    images = [
        texture[:, :h, s : s + WIDTH].permute(1, 2, 0) for s, h in zip(shifts, rows, strict=True)
    ]
    nothing = tuple(torch.zeros(h, WIDTH, dtype=torch.bool) for h in rows)
    return StereoViews(
        tuple(images), poses, intrinsics.double().repeat(count, 1, 1), nothing, nothing
    )
