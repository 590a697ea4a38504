"""The backward pass of projection, on the emulation, against autograd through the reference."""

import math
from dataclasses import replace
from itertools import product

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from support.projection_jobs import (
    SCENES,
    Backward,
    Expected,
    Projection,
    Scene,
    projected,
    reference_of,
    run_backward,
    scene_of,
)
from support.sampling import sampled
from support.scenes import front_camera, random_splats
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.kernels.cuda.source_files import constant
from gsfw.kernels.render_arguments import POSE_FIELDS
from gsfw.rasterizers.cuda.stages import SPLAT_CHANNELS, SUM_CHANNELS
from gsfw.studies.stress.catalogue import CHANGES
from gsfw.studies.stress.catalogue.views import CAMERAS

SLOTS_BY_ONE_LANE = constant("gradients.h", "SLOTS_BY_ONE_LANE")

BINARY = math.sqrt(0.5 / math.log(2))
"""By how much u and v are larger where alpha is a power of two."""


def random_sums(projection: Projection, rows: int | None = None) -> Tensor:
    """What blending may have left: moments, channels, and two magnitudes."""
    generator = torch.Generator().manual_seed(8)
    shape = (
        len(projection.radii) if rows is None else rows,
        SUM_CHANNELS + projection.channels + 2,
    )
    sums = torch.randn(shape, generator=generator, dtype=torch.float64)
    sums[:, -2:].abs_()
    return sums.to(projection.radii.dtype)


def image_gradients(expected: Expected, sums: Tensor) -> tuple[Tensor, Tensor]:
    """dL/d mean [m, 2] and dL/d covariance [m, 3] by the formulas of falloff.h."""
    xx, xy = expected.ellipses.covariances.detach()[:, :2].unbind(1)
    last = (expected.ellipses.determinants.detach() / xx).sqrt()
    root = torch.stack([xx.sqrt(), torch.zeros_like(xx), xy / xx.sqrt(), last], 1)
    inverse = torch.linalg.inv(root.view(-1, 2, 2))
    first, second = sums[:, 1:3, None] / BINARY, sums[:, [3, 4, 4, 5]].view(-1, 2, 2) / BINARY**2
    by_mean = (inverse.mT @ first)[:, :, 0]
    by_covariance = 0.5 * inverse.mT @ second @ inverse
    return by_mean, by_covariance.flatten(1)[:, [0, 1, 3]] * torch.tensor([1, 2, 1])


def expected_gradients(scene: Scene, sums: Tensor) -> dict[str, Tensor]:
    """By autograd, for the sums of every row."""
    expected = reference_of(*scene)
    ellipses, mine = expected.ellipses, sums[expected.rows]
    by_mean, by_covariance = image_gradients(expected, mine)
    by_opacity = mine[:, 0] / ellipses.opacities.detach()
    channels = expected.channels.shape[1]
    loss = (ellipses.means * by_mean).sum() + (ellipses.covariances * by_covariance).sum()
    loss = loss + (ellipses.opacities * by_opacity).sum()
    loss = loss + (expected.channels * mine[:, SUM_CHANNELS:][:, :channels]).sum()
    inputs = list(expected.leaves.values())
    gradients = torch.autograd.grad(loss, inputs, allow_unused=True, materialize_grads=True)
    return dict(zip(expected.leaves, gradients, strict=True))


def pose_gradient(found: Backward, camera: Cameras) -> Tensor:
    """dL/d world_to_camera: the centre is -R^T t."""
    assert found.pose is not None
    sums, pose = found.pose.double().sum(0), camera.world_to_camera[0].double()
    rotation, translation = pose[:3, :3], pose[:3, 3]
    gradient = torch.zeros(1, 4, 4, dtype=sums.dtype)
    gradient[0, :3, :3] = sums[:9].view(3, 3) - torch.outer(translation, sums[12:])
    gradient[0, :3, 3] = sums[9:12] - rotation @ sums[12:]
    return gradient


def check(found: Backward, expected: dict[str, Tensor], camera: Cameras, tolerance: float) -> None:
    gradients = found.gradients | {"world_to_camera": pose_gradient(found, camera)}
    assert gradients.keys() == expected.keys()
    for name, tensor in expected.items():
        difference = gradients[name].double() - tensor.reshape(gradients[name].shape)
        assert difference.norm() <= tolerance * tensor.norm() or tensor.norm() == 0, name
        assert difference.isfinite().all(), name


@pytest.mark.parametrize("name", SCENES)
def test_gradients_are_those_of_autograd(name):
    scene = scene_of(name)
    projection = projected(scene)
    sums = random_sums(projection)
    found = run_backward(EmulatedLauncher(), projection, sums)
    check(found, expected_gradients(scene, sums), scene[1], 1e-9)
    hidden, offsets = projection.visible == 0, projection.tensors["offsets"]
    for key, gradient in found.gradients.items():
        ragged = key == "rest" and offsets is not None
        rows = hidden.repeat_interleave(offsets.diff()) if ragged else hidden
        assert (gradient[rows] == 0).all()


def test_float_is_as_near_as_its_rounding():
    scene = scene_of("SH in two parts", torch.float32)
    projection = projected(scene)
    sums = random_sums(projection)
    found = run_backward(EmulatedLauncher(), projection, sums)
    wide = (scene[0].map(torch.Tensor.double), scene[1].to(dtype=torch.float64), scene[2])
    check(found, expected_gradients(wide, sums.double()), wide[1], 1e-4)


@pytest.mark.parametrize("name", ["SH in two parts", "half active covariances", "channels"])
def test_statistics_are_gradients_per_half_image(name):
    scene = scene_of(name)
    projection = projected(scene)
    sums, expected = random_sums(projection), reference_of(*scene)
    found = run_backward(EmulatedLauncher(), projection, sums)
    half = torch.tensor([0.5 * scene[1].width, 0.5 * scene[1].height], dtype=torch.float64)
    by_mean, _ = image_gradients(expected, sums[expected.rows])
    magnitudes = sums[expected.rows, -2:] / BINARY**2
    for statistic, wanted in ((found.screen_gradient, by_mean), (found.absgrad, magnitudes)):
        torch.testing.assert_close(statistic[expected.rows], (wanted * half).norm(dim=1))
        assert (statistic[~expected.visible] == 0).all()


@pytest.mark.parametrize("name", ["SH in two parts", "ragged", "channels"])
def test_a_further_camera_adds_to_the_gradients(name):
    scene = scene_of(name)
    projection = projected(scene)
    sums = random_sums(projection)
    once = run_backward(EmulatedLauncher(), projection, sums)
    before = {key: torch.randn_like(held) for key, held in once.gradients.items()}
    twice = run_backward(EmulatedLauncher(), projection, sums, before=before)
    for key, gradient in once.gradients.items():
        assert torch.equal(twice.gradients[key], before[key] + gradient), key


@pytest.mark.parametrize("name", ["SH in two parts", "channels"])
def test_slots_are_summed_row_by_row(name):
    scene = scene_of(name)
    projection = projected(scene)
    projection.tile_counts[::3] *= 5 * SLOTS_BY_ONE_LANE  # Summed by a whole warp, if visible.
    counts = projection.tile_counts.long()
    order = torch.randperm(len(counts), generator=torch.Generator().manual_seed(0))
    ends = torch.empty_like(counts)
    ends[order] = counts[order].cumsum(0)
    slots = random_sums(projection, int(counts.sum()))
    sums = torch.stack(
        [slots[end - count : end].sum(0) for end, count in zip(ends, counts, strict=True)]
    )
    found = run_backward(EmulatedLauncher(), projection, slots, ends)
    check(found, expected_gradients(scene, sums), scene[1], 1e-9)


def test_what_is_not_wanted_is_not_written():
    scene = scene_of("SH in two parts")
    projection = projected(scene)
    sums = random_sums(projection)
    everything = run_backward(EmulatedLauncher(), projection, sums)
    for names in (("colors", "means"), ("rest", "quats", "opacities"), ("scales",)):
        found = run_backward(EmulatedLauncher(), projection, sums, pose=False, without=names)
        assert not found.gradients.keys() & names
        for key, gradient in found.gradients.items():
            assert torch.equal(gradient, everything.gradients[key]), key


def test_the_order_in_which_threads_run_changes_no_bit():
    scene = scene_of("SH in two parts", torch.float32)
    projection = projected(scene)
    sums = random_sums(projection)
    first = run_backward(EmulatedLauncher(), projection, sums)
    assert first.pose is not None
    assert first.pose.shape == (2, POSE_FIELDS)
    for seed in range(1, 9):
        again = run_backward(EmulatedLauncher(seed=seed, os_threads=2), projection, sums)
        assert again.pose is not None
        assert torch.equal(first.pose, again.pose)
        for key, gradient in first.gradients.items():
            assert torch.equal(gradient, again.gradients[key]), key


def test_bands_above_the_active_degree_have_no_gradient():
    scene = scene_of("constant colours of covariances")
    projection = projected(scene)
    sums = random_sums(projection)
    found = run_backward(EmulatedLauncher(), projection, sums)
    check(found, expected_gradients(scene, sums), scene[1], 1e-9)
    assert (found.gradients["rest"] == 0).all()
    before = {key: torch.ones_like(held) for key, held in found.gradients.items()}
    added = run_backward(EmulatedLauncher(), projection, sums, before=before)
    assert (added.gradients["rest"] == 1).all()


def test_splats_without_a_finite_number_that_are_hidden_have_gradient_zero():
    splats, *others = scene_of("SH in two parts", torch.float32)
    broken = splats.map(lambda held: held.clone())
    for tensor in broken.tensors().values():
        tensor[::2] = torch.nan
    projection = projected((broken, *others))
    found = run_backward(EmulatedLauncher(), projection, random_sums(projection))
    assert (projection.visible[::2] == 0).all()
    assert found.pose is not None
    assert found.pose.isfinite().all()
    for key, gradient in found.gradients.items():
        assert (gradient[::2] == 0).all(), key
        assert gradient.isfinite().all(), key


def test_a_clamped_colour_has_no_gradient():
    splats = random_splats(30, 3, dtype=torch.float64)
    assert isinstance(splats.colors, Sh)
    splats.colors.coefficients[::2] = 0
    splats.colors.coefficients[::2, 0] = -10
    scene = (splats, front_camera(dtype=torch.float64), RenderSettings())
    projection = projected(scene)
    assert (projection.projected[::2, SPLAT_CHANNELS : SPLAT_CHANNELS + 3] == 0).all()
    found = run_backward(EmulatedLauncher(), projection, random_sums(projection))
    assert (found.gradients["colors"][::2] == 0).all()
    assert (found.gradients["colors"][1::2] != 0).any()


EXTREME = RenderSettings(antialias=True, depth=Depth.ACCUMULATED, near=1e-7)


def check_finite(splats: Splats, camera: Cameras) -> None:
    projection = projected((splats, camera, EXTREME))
    assert projection.projected[projection.visible == 1].isfinite().all()
    # Blending's sums vanish with alpha, and pixels are no further from the centre than alpha lasts.
    sums = 0.01 * random_sums(projection) * splats.opacities[:, None]
    found = run_backward(EmulatedLauncher(), projection, sums)
    assert found.pose is not None
    assert found.pose.isfinite().all()
    assert found.screen_gradient.isfinite().all()
    for key, gradient in found.gradients.items():
        assert gradient.isfinite().all(), key


@pytest.mark.parametrize(
    ("name", "model"),
    sampled(list(product(CHANGES, CameraModel)), daily=range(0, 3 * len(CHANGES), 4)),
)
def test_gradients_of_extreme_splats_are_finite(name, model):
    camera = replace(front_camera(20, 15), model=model)
    check_finite(CHANGES[name](random_splats(20, 1)), camera)


@pytest.mark.parametrize("name", CAMERAS)
def test_gradients_by_extreme_cameras_are_finite(name):
    check_finite(random_splats(20, 1), CAMERAS[name](front_camera(20, 15)))
