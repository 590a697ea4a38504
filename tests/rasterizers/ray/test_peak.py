"""Peaks along true rays, against splatting, closed forms and a search along the ray."""

import math
from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats, turned_camera

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.lens import project_points
from gsfw.core.maths.rays import pixel_rays
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.rasterizers.ray.footprint import pixel_steps
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

RAY = RayRasterizer()
BARE = RayRasterizer(matched=False)
REFERENCE = ReferenceRasterizer()
SMOOTH = RenderSettings(profile=DEFAULT.without_cutoffs())


def lone(mean, scales, opacity=0.9, quat=(1.0, 0.0, 0.0, 0.0)):
    """One white Gaussian."""
    return Splats(
        means=torch.tensor([mean], dtype=torch.float64),
        opacities=torch.tensor([opacity], dtype=torch.float64),
        colors=torch.ones(1, 1, dtype=torch.float64),
        quats=torch.tensor([quat], dtype=torch.float64),
        scales=torch.tensor([scales], dtype=torch.float64),
    )


def eye_camera(width, height, focal, model=CameraModel.PINHOLE):
    """A camera at the origin that looks along +z."""
    intrinsics = torch.tensor(
        [[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]], dtype=torch.float64
    )
    pose = torch.eye(4, dtype=torch.float64)
    return Cameras(pose[None], intrinsics[None], width, height, model)


@pytest.mark.parametrize("form", ["axes", "covariances"])
@pytest.mark.parametrize("settings", [RenderSettings(), SMOOTH], ids=["cut-offs", "smooth"])
def test_orthographic_images_are_those_of_the_reference(form, settings):
    # Parallel rays make the projection affine, and splatting exact.
    splats = random_splats(60, 2, dtype=torch.float64)
    if form == "covariances":
        axes = rotation_matrices(splats.quats) * splats.scales[:, None]
        splats = replace(splats, quats=None, scales=None, covariances=axes @ axes.transpose(1, 2))
    splats = replace(splats, extra=splats.means)
    camera = turned_camera(CameraModel.ORTHOGRAPHIC)
    background = torch.tensor([0.2, -1.0, 3.0], dtype=torch.float64)
    for depth in (Depth.EXPECTED, Depth.ACCUMULATED):
        asked = replace(
            settings,
            background=background,
            depth=depth,
            statistics=frozenset({Statistic.CONTRIBUTION}),
        )
        ours, theirs = (r.render(splats, camera, asked) for r in (RAY, REFERENCE))
        for name in ("color", "alpha", "depth", "extra"):
            found, expected = getattr(ours, name), getattr(theirs, name)
            torch.testing.assert_close(found, expected, rtol=0, atol=1e-10, msg=name)
        torch.testing.assert_close(
            ours.statistics.contribution, theirs.statistics.contribution, rtol=0, atol=1e-10
        )
        assert ours.statistics.visible.sum() <= theirs.statistics.visible.sum()


@pytest.mark.parametrize("model", [CameraModel.PINHOLE, CameraModel.FISHEYE])
def test_the_difference_from_splatting_falls_with_the_angle_that_a_gaussian_spans(model):
    # The affine approximation leaves out what is quadratic in extent over distance; images keep
    # their size in pixels while that ratio falls by 4 each time.
    errors = []
    for zoom in (1.0, 4.0, 16.0):
        splats = lone((0.0, 0.0, 4.0 * zoom), (0.3, 0.1, 0.2), quat=(0.9, 0.3, -0.2, 0.4))
        camera = eye_camera(40, 30, 80.0 * zoom, model)
        images = [r.render(splats, camera, SMOOTH).color for r in (RAY, REFERENCE)]
        errors.append((images[0] - images[1]).abs().max().item())
    assert errors[0] > 1e-2
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3


def test_distant_small_gaussians_agree_with_splatting():
    splats = random_splats(200, 1, dtype=torch.float64)
    camera = front_camera(64, 48, distance=1000.0, dtype=torch.float64)
    intrinsics = camera.intrinsics.clone()
    intrinsics[0, [0, 1], [0, 1]] = 20_000.0
    camera = replace(camera, intrinsics=intrinsics)
    images = [r.render(splats, camera, SMOOTH).color for r in (RAY, REFERENCE)]
    assert (images[0] - images[1]).abs().max() < 5e-3


@pytest.mark.parametrize("model", list(CameraModel))
def test_the_matched_dilation_is_three_tenths_of_a_pixel_squared(model):
    points = torch.tensor([[0.3, -0.2, 1.5], [2.0, 1.0, 1.0]], dtype=torch.float64)
    camera = eye_camera(40, 30, 25.0, model)
    _, jacobian = project_points(points, camera, margin=torch.inf)
    steps = pixel_steps(points, camera)
    identity = torch.eye(2, dtype=torch.float64).expand(2, 2, 2)
    torch.testing.assert_close(jacobian @ steps, identity)
    if model is not CameraModel.ORTHOGRAPHIC:
        along = (points[:, None] @ steps)[:, 0]
        torch.testing.assert_close(along, torch.zeros_like(along), msg="it moves across the ray")


def test_a_point_is_as_wide_as_in_splatting():
    # Its whole width is the dilation, off the axis as on it.
    for mean in ((0.0, 0.0, 2.0), (1.2, -0.7, 2.0)):
        splats = lone(mean, (0.0, 0.0, 0.0))
        camera = eye_camera(120, 80, 80.0)
        ours, theirs = (r.render(splats, camera).color for r in (RAY, REFERENCE))
        assert theirs.max() > 0.3
        assert (ours - theirs).abs().max() < 2e-2


def test_a_sphere_60_degrees_off_the_axis_has_the_outline_that_perspective_gives_it():
    # The tangent cone of a sphere of radius k s: the sine of its half angle is k s / distance.
    # Cut by the image plane it is an ellipse, which splatting draws too small and off its place.
    distance, scale, opacity = 2.0, 0.15, 0.9
    angle = math.radians(60)
    mean = (distance * math.sin(angle), 0.0, distance * math.cos(angle))
    camera = eye_camera(1101, 3, 150.0)
    reach = math.sqrt(2 * math.log(opacity * 255)) * scale
    half = math.asin(reach / distance)
    right, left = (math.tan(angle + sign * half) * 150.0 + 550.5 for sign in (1, -1))
    splats = lone(mean, (scale,) * 3, opacity)
    drawn = {
        name: rasterizer.render(splats, camera).alpha[0, 1, :, 0].nonzero()[:, 0]
        for name, rasterizer in (("ray", BARE), ("splat", REFERENCE))
    }
    assert drawn["ray"].min() + 0.5 == pytest.approx(left, abs=1)
    assert drawn["ray"].max() + 0.5 == pytest.approx(right, abs=1)
    # What splatting makes of it: the same k sigma about the projected mean, with the derivative
    # there, f / z (1 + x^2 / z^2)^0.5 times the scale across; its dilation adds 0.3.
    slope = math.tan(angle)
    sigma = 150.0 / mean[2] * math.sqrt(1 + slope**2) * scale
    affine = math.sqrt(2 * math.log(opacity * 255) * (sigma**2 + 0.3))
    middle = 150.0 * slope + 550.5
    assert drawn["splat"].max() + 0.5 == pytest.approx(middle + affine, abs=1)
    assert right - (middle + affine) > 100, "pixels that splatting leaves out"


@pytest.mark.parametrize("model", list(CameraModel))
def test_alpha_is_the_largest_along_the_ray(model):
    splats = lone((0.9, -0.4, 1.5), (0.5, 0.02, 0.2), quat=(0.8, 0.1, -0.5, 0.3))
    camera = eye_camera(13, 9, 4.0, model)
    found = BARE.render(splats, camera, SMOOTH).alpha[0, :, :, 0]
    rays = pixel_rays(camera)[0].view(-1, 6)
    axes = rotation_matrices(splats.quats)[0] / splats.scales[0]
    low, high = torch.full((len(rays), 1), 1e-9), torch.full((len(rays), 1), 30.0)
    low = low.double() if model is not CameraModel.ORTHOGRAPHIC else low.double() - 30
    high = high.double()
    for _ in range(12):  # A search that narrows to a twentieth each time.
        places = low + (high - low) * torch.linspace(0, 1, 41, dtype=torch.float64)
        points = rays[:, None, :3] + places[:, :, None] * rays[:, None, 3:]
        alphas = 0.9 * (-0.5 * ((points - splats.means[0]) @ axes).square().sum(2)).exp()
        best = alphas.argmax(1, keepdim=True)
        step = (high - low) / 40
        low, high = (places.gather(1, best) + sign * step for sign in (-1, 1))
    expected = alphas.amax(1).view(camera.height, camera.width)
    # A peak behind the eye is not seen, where the search finds the ray's first point.
    behind = (best[:, 0] == 0).view_as(expected) & (found == 0)
    torch.testing.assert_close(found[~behind], expected[~behind], rtol=1e-9, atol=1e-12)
    assert (found > 0.05).sum() > 3


def test_the_order_by_ray_sorts_what_the_means_do_not():
    # Two discs that cross: each is in front on one side, and splatting knows one order only.
    turn = math.radians(35)
    quats = [(math.cos(a / 2), 0.0, math.sin(a / 2), 0.0) for a in (turn, -turn)]
    both = [lone((0.0, 0.0, 4.0), (1.0, 1.0, 0.0), 0.99, quat) for quat in quats]
    splats = Splats(
        means=torch.cat([one.means for one in both]),
        opacities=torch.cat([one.opacities for one in both]),
        colors=torch.eye(2, dtype=torch.float64),
        quats=torch.cat([one.quats for one in both]),
        scales=torch.cat([one.scales for one in both]),
    )
    camera = eye_camera(40, 30, 40.0)
    settings = RenderSettings(depth=Depth.EXPECTED)
    by_mean = RayRasterizer(Peak("mean")).render(splats, camera, settings)
    by_ray = RayRasterizer(Peak("ray")).render(splats, camera, settings)
    left, right = (slice(None), slice(12, 16)), (slice(None), slice(24, 28))
    for image, sides in ((by_mean.color[0, 15:16], "one"), (by_ray.color[0, 15:16], "both")):
        first = [bool((image[side][..., 0] > image[side][..., 1]).all()) for side in (left, right)]
        assert (first[0] == first[1]) == (sides == "one")
    torch.testing.assert_close(by_mean.alpha, by_ray.alpha)
    depth = by_mean.depth[by_mean.alpha > 0.5]
    torch.testing.assert_close(depth, torch.full_like(depth, 4.0))
    assert by_ray.depth[0, 15, 26] < 3.9, "that of the nearer disc there"


def test_what_is_behind_the_near_plane_or_the_eye_is_not_drawn():
    camera = eye_camera(20, 20, 5.0)
    for depth, seen in ((0.02, True), (0.005, False), (-1.0, False)):
        image = RAY.render(lone((0.0, 0.0, depth), (0.5,) * 3), camera)
        assert bool(image.alpha.max() > 0) == seen
        assert bool(image.statistics.visible.item()) == seen
    sideways = lone((2.0, 0.0, 0.1), (0.5,) * 3)
    assert BARE.render(sideways, camera).alpha[0, :, :2].max() == 0, "rays away from it"
    assert BARE.render(sideways, camera).alpha[0, :, -1].max() > 0.2


def test_a_fisheye_sees_nothing_beyond_180_degrees():
    splats = lone((0.0, 0.0, 1.0), (50.0,) * 3, 0.9)
    focal = 40 / (2 * math.pi)  # The image's edge is 180 degrees from its axis.
    image = RAY.render(splats, eye_camera(60, 60, focal, CameraModel.FISHEYE), SMOOTH).alpha[0]
    assert image[30, 30] > 0.8
    assert image[0, 0] == 0
