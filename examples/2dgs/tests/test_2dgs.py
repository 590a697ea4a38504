"""Depths, distortion and normals of surfels are those of planes; a run improves its normals."""

import json
import subprocess
import sys
from types import SimpleNamespace

import torch
from gsfw_2dgs.planes import PRODUCTS, Surface, pixel_directions, plane_channels

from gsfw.api import Cameras
from gsfw.testing import conformance

test_conforms = conformance("plugin", "gsfw-2dgs")

SCENE = (
    *("datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=48"),
    *("datamanager.height=36", "datamanager.points=400", "device=cpu", "report=false"),
)


def camera():
    matrix = torch.tensor([[20.0, 0.0, 8.0], [0.0, 22.0, 6.0], [0.0, 0.0, 1.0]])
    return Cameras(torch.eye(4)[None], matrix[None], 16, 12)


def surfels(generator):
    """Means before the camera, and rotations that do not face it at a slant."""
    means = torch.rand(5, 3, generator=generator) * torch.tensor([1.0, 1.0, 2.0])
    quats = torch.tensor([1.0, 0, 0, 0]) + 0.3 * torch.randn(5, 4, generator=generator)
    return means + torch.tensor([-0.5, -0.5, 3.0]), quats


def intersections(means, quats, rays):
    """Depths [n, h, w] at which rays meet planes, by their definition."""
    from gsfw.api import rotation_matrices

    normals = rotation_matrices(quats)[:, :, 2]
    along = torch.einsum("nk,hwk->nhw", normals, rays)
    return (normals * means).sum(1)[:, None, None] / along


def blended(means, quats, weights):
    """A render of surfels that cover the whole image with given weights."""
    channels = plane_channels(means, quats, camera())
    extra = (weights[:, None] * channels).sum(0).expand(1, 12, 16, 12)
    alpha = weights.sum().expand(1, 12, 16, 1)
    return Surface(SimpleNamespace(extra=extra, alpha=alpha), camera())


def test_the_depth_of_one_surfel_is_that_of_the_ray_splat_intersection():
    means, quats = (part[:1] for part in surfels(torch.Generator().manual_seed(1)))
    found = blended(means, quats, torch.tensor([1.0])).depth()[..., 0]
    expected = intersections(means, quats, pixel_directions(camera(), means))[0]
    assert torch.allclose(found, expected, rtol=1e-4)


def test_distortion_is_the_sum_over_all_pairs():
    means, quats = surfels(torch.Generator().manual_seed(2))
    weights = torch.tensor([0.3, 0.25, 0.2, 0.1, 0.05])
    inverse = 1 / intersections(means, quats, pixel_directions(camera(), means))
    pairs = (inverse[:, None] - inverse[None]).square() * (weights[:, None] * weights)[
        ..., None, None
    ]
    found = blended(means, quats, weights).distortion()[..., 0]
    assert torch.allclose(found, 0.5 * pairs.sum((0, 1)), rtol=1e-2, atol=1e-6)
    assert len(PRODUCTS) == 6


def test_normals_of_the_depth_of_one_surfel_are_its_own():
    means, quats = (part[:1] for part in surfels(torch.Generator().manual_seed(3)))
    surface = blended(means, quats, torch.tensor([1.0]))
    agreement = (surface.depth_normals() * surface.normals[1:-1, 1:-1]).sum(-1)
    assert torch.allclose(agreement, torch.ones_like(agreement), atol=1e-4)


def test_grazing_surfels_have_finite_channels():
    means = torch.tensor([[0.0, 0.0, 2.0]])
    quats = torch.tensor([[0.7071, 0.7071, 0.0, 0.0]], requires_grad=True)  # Normal across.
    channels = plane_channels(means, quats, camera())
    channels.square().sum().backward()
    assert bool(channels.isfinite().all())
    assert bool(quats.grad.isfinite().all())


def test_losses_of_geometry_make_normals_and_depth_agree(tmp_path):
    def train(name, *settings):
        command = [sys.executable, "-m", "gsfw", "train", "method=2dgs", *SCENE, *settings]
        found = subprocess.run(
            [*command, "steps=150", f"out={tmp_path / name}", "json=true"],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return json.loads(found.stdout)

    plain = train("plain", "normal_weight=0", "distortion_weight=0", "rescale=false")
    held = train(
        "held", "normal_weight=0.3", "normal_start=20", "distortion_start=20", "rescale=false"
    )
    assert held["normal_spread"] < 0.85 * plain["normal_spread"]
    assert held["psnr"] > plain["psnr"] - 3
