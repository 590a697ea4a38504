"""Rasterizers as a whole: trusted images, batches, forms, refusals."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import Cameras
from gsfw.core.numerics import GSPLAT_1_5
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats


def read_safetensors(path: Path) -> dict[str, torch.Tensor]:
    """The float32 tensors of a file: 8 bytes of length, a JSON header, then raw numbers."""
    data = path.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    tensors = {}
    for name, entry in json.loads(data[8 : 8 + length]).items():
        if name != "__metadata__":
            assert entry["dtype"] == "F32"
            first, last = (8 + length + offset for offset in entry["data_offsets"])
            values = torch.frombuffer(bytearray(data[first:last]), dtype=torch.float32)
            tensors[name] = values.view(entry["shape"])
    return tensors


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("case", ["tiny_case", "basic_case"])
def test_images_of_a_trusted_rasterizer_are_reproduced(rasterizer, shared_data, case, dtype):
    named = read_safetensors(shared_data / "reference" / f"{case}.safetensors")
    expected = named["out_img"]
    named = {name: tensor.to(dtype) for name, tensor in named.items()}
    splats = Splats(
        means=named["means"],
        opacities=named["opacities"].sigmoid(),
        colors=Sh(named["coeffs"], 3),
        quats=named["quats"],
        scales=named["scales"].exp(),
    )
    height, width, _ = expected.shape
    view = torch.eye(4, dtype=dtype)
    view[:3, 3] = -torch.tensor([0.123, 0.456, -8.0], dtype=dtype)
    k = torch.tensor([[61.5, 0, width / 2], [0, 61.5, height / 2], [0, 0, 1]], dtype=dtype)
    output = rasterizer.render(
        splats, Cameras(view[None], k[None], width, height), RenderSettings(profile=GSPLAT_1_5)
    )
    found = torch.cat([output.color, output.alpha], dim=3)[0]
    assert (found - expected).abs().max() < 5e-6


def views(dtype: torch.dtype = torch.float64) -> Cameras:
    """Three different cameras of one size."""
    parts = [front_camera(30, 22, distance=d, dtype=dtype) for d in (3.0, 4.0, 5.0)]
    cameras = Cameras.cat(parts)
    return replace(cameras, intrinsics=cameras.intrinsics * torch.tensor([[[1.0]], [[1.1]], [[1]]]))


def test_a_batch_of_cameras_equals_its_cameras_one_by_one(rasterizer):
    splats = random_splats(30, 2, dtype=torch.float64)
    splats = replace(splats, extra=torch.rand(30, 2, dtype=torch.float64))
    settings = RenderSettings(depth=Depth.EXPECTED, statistics=frozenset(Statistic))
    means = splats.means.clone().requires_grad_()
    batch = rasterizer.render(replace(splats, means=means), views(), settings)
    batch.color.square().sum().backward()
    together = means.grad
    means = splats.means.clone().requires_grad_()
    for index in range(3):
        one = rasterizer.render(replace(splats, means=means), views().select([index]), settings)
        one.color.square().sum().backward()
        for name in ("color", "alpha", "depth", "extra"):
            assert torch.equal(getattr(one, name)[0], getattr(batch, name)[index]), name
        for name in ("visible", "radii", "screen_gradient", "absgrad", "contribution"):
            found, expected = getattr(one.statistics, name), getattr(batch.statistics, name)
            assert torch.equal(found[0], expected[index]), name
    assert together is not None
    assert means.grad is not None
    torch.testing.assert_close(together, means.grad)


@pytest.mark.parametrize("antialias", [False, True])
def test_the_covariance_form_draws_what_quats_and_scales_draw(rasterizer, antialias):
    splats = random_splats(30, 1, dtype=torch.float64)
    assert splats.quats is not None
    assert splats.scales is not None
    w, x, y, z = (splats.quats / splats.quats.norm(dim=1, keepdim=True)).unbind(1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).view(-1, 3, 3)
    rotations = torch.eye(3) + 2 * w[:, None, None] * cross + 2 * cross @ cross
    axes = rotations * splats.scales[:, None]
    other = replace(splats, quats=None, scales=None, covariances=axes @ axes.transpose(1, 2))
    settings = RenderSettings(antialias=antialias)
    images = [
        rasterizer.render(scene, front_camera(dtype=torch.float64), settings).color
        for scene in (splats, other)
    ]
    torch.testing.assert_close(images[0], images[1], rtol=0, atol=1e-10)


def test_bands_above_the_active_degree_are_ignored(rasterizer):
    splats = random_splats(10, 3)
    assert isinstance(splats.colors, Sh)
    coefficients = splats.colors.coefficients
    for degree in range(4):
        kept = coefficients[:, : (degree + 1) ** 2].clone()
        images = [
            rasterizer.render(replace(splats, colors=colors), front_camera()).color
            for colors in (Sh(coefficients, degree), Sh(kept, degree), Sh(kept, 4))
        ]
        assert torch.equal(images[0], images[1])
        assert torch.equal(images[0], images[2]), "bands that are not there count as zero"


def test_colours_are_seen_from_the_camera_and_not_below_zero(rasterizer):
    direction = torch.tensor([0.28, 0.0, 0.96], dtype=torch.float64)
    colors = torch.zeros(1, 4, 3, dtype=torch.float64)
    colors[0, 3, 0], colors[0, 2, 1], colors[0, 0, 2] = 1.0, 1.0, -10.0
    splats = Splats(
        means=2 * direction[None],
        opacities=torch.ones(1, dtype=torch.float64),
        colors=Sh(colors, 1),
        quats=torch.ones(1, 4, dtype=torch.float64),
        scales=torch.ones(1, 3, dtype=torch.float64),
    )
    camera = front_camera(100, 4, distance=0.0, dtype=torch.float64)
    color = rasterizer.render(splats, camera).color[0]
    peak = color.reshape(-1, 3).amax(0) / 0.99
    expected = [0.5 - 0.4886025119029199 * 0.28, 0.5 + 0.4886025119029199 * 0.96, 0.0]
    assert peak.tolist() == pytest.approx(expected, rel=1e-9)
