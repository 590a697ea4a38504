"""Where Gaussians start."""

import pytest
import torch
from support.scenes import random_splats

from gsfw.core.errors import DataError
from gsfw.core.maths.focus import fitted_sphere, focus
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats
from gsfw.methods.gaussians3d.initialisation import (
    LONE_SPACING,
    from_points,
    from_splats,
    random_box,
    random_points,
    usable_points,
)


def scene(
    points=(), centers=((0.0, 0, -5), (1, 0, -5)), extent=1.0, has_alpha=False, axes=None
) -> Scene:
    positions = torch.tensor(points, dtype=torch.float32).reshape(-1, 3)
    return Scene(
        "toy",
        positions,
        torch.full_like(positions, 0.25),
        torch.as_tensor(centers, dtype=torch.float32),
        extent,
        has_alpha=has_alpha,
        camera_axes=axes,
    )


def started(points, **options):
    settings = {"extent": 1.0, "scale": 1.0, "opacity": 0.1, "sh_degree": 1} | options
    positions = torch.tensor(points)
    colors = torch.full_like(positions, 0.25)
    return from_points(positions, colors, operators=Operators(), **settings)


def test_every_point_becomes_a_round_gaussian_as_large_as_its_neighbours_are_far():
    start = started([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [50, 0, 0]], scale=0.5)
    torch.testing.assert_close(start.log_scales[0].exp(), torch.full((3,), 0.5 * (1 + 2 + 3) / 3))
    torch.testing.assert_close(start.opacity_logits.sigmoid(), torch.full((5,), 0.1))
    colors = 0.5 + 0.28209479177387814 * start.sh[:, 0]
    torch.testing.assert_close(colors, torch.full((5, 3), 0.25))
    assert start.sh.shape == (5, 4, 3)
    assert not start.sh[:, 1:].any()


def test_fewer_than_four_points_use_the_neighbours_there_are():
    start = started([[0.0, 0, 0], [2, 0, 0]])
    torch.testing.assert_close(start.log_scales.exp(), torch.full((2, 3), 2.0))
    lone = started([[0.0, 0, 0]], extent=3.0)
    torch.testing.assert_close(lone.log_scales.exp(), torch.full((1, 3), 3 * LONE_SPACING))


def test_points_that_nothing_can_come_of_are_left_out_and_counted():
    nan, inf = float("nan"), float("inf")
    kept, colors, dropped = usable_points(
        scene(
            [[0, 0, 0], [nan, 0, 0], [1, 1, 1], [0, 0, 0], [0, inf, 0], [0, 0, 0], [1, 0, -5.005]],
        )
    )
    assert kept.tolist() == [[0, 0, 0], [1, 1, 1]]
    assert colors.shape == (2, 3)
    assert dropped == {"not finite": 2, "a copy of another": 2, "at a camera": 1}


def test_no_points_are_no_points():
    kept, _, dropped = usable_points(scene())
    assert len(kept) == 0
    assert dropped == {}


def hemisphere(radius, n=60):
    directions = torch.randn(n, 3, generator=torch.Generator().manual_seed(0))
    directions[:, 2] = directions[:, 2].abs()
    return radius * directions / directions.norm(dim=1, keepdim=True)


def extent_of(centers):
    return float(1.1 * (centers - centers.mean(0)).norm(dim=1).max())


def test_an_object_is_looked_for_at_the_centre_of_its_cameras_sphere():
    centers = hemisphere(4.03) + torch.tensor([7.0, 0, 0])
    capture = scene(centers=centers, extent=extent_of(centers), has_alpha=True)
    center, half = random_box(capture)
    torch.testing.assert_close(center, torch.tensor([7.0, 0, 0]), atol=1e-3, rtol=0)
    assert half == pytest.approx(1.33, abs=0.01)


def test_a_ring_of_cameras_has_its_object_in_the_middle():
    angle = torch.linspace(0, 6.0, 40)
    noise = 0.001 * torch.randn(40, generator=torch.Generator().manual_seed(0))
    centers = torch.stack([2 * angle.cos(), 2 * angle.sin(), 1 + noise], dim=1)
    sphere = fitted_sphere(centers, 10.0)
    assert sphere is not None
    torch.testing.assert_close(sphere[0], torch.tensor([0.0, 0, 1]), atol=0.01, rtol=0)
    assert sphere[1] == pytest.approx(2, abs=0.01)


def test_cameras_side_by_side_or_along_a_path_are_on_no_sphere():
    grid = torch.cartesian_prod(torch.arange(5.0), torch.arange(4.0), torch.zeros(1))
    assert fitted_sphere(grid, extent_of(grid) * 1.5) is None
    line = torch.arange(10.0)[:, None] * torch.tensor([1.0, 0.1, 0])
    assert fitted_sphere(line, extent_of(line) * 1.5) is None
    assert fitted_sphere(grid[:1], 1.0) is None
    center, half = random_box(scene(centers=grid, extent=3.0, has_alpha=True))
    torch.testing.assert_close(center, grid.mean(0))
    assert half == 3.0


def test_other_captures_start_all_around_their_cameras():
    center, half = random_box(scene(centers=[[1.0, 0, 0], [3, 0, 0]], extent=1.1))
    assert center.tolist() == [2, 0, 0]
    assert half == pytest.approx(3.3)


def looking_at(point, centers):
    axes = torch.tensor(point) - torch.as_tensor(centers, dtype=torch.float32)
    return axes / axes.norm(dim=1, keepdim=True)


ARC = [[-2.3, -1.3, 0.3], [-1.3, -2.0, 1.2], [0.3, -2.4, 1.2], [1.7, -1.6, 0.2]]
"""Cameras in front of something, at several distances of it."""


def test_an_object_is_where_all_cameras_look():
    capture = scene(centers=ARC, axes=looking_at([0.5, 0.5, 0.0], ARC), has_alpha=True)
    center, half = random_box(capture)
    torch.testing.assert_close(center, torch.tensor([0.5, 0.5, 0.0]), atol=1e-5, rtol=0)
    distances = (torch.tensor(ARC) - center).norm(dim=1)
    assert half == pytest.approx(0.33 * float(distances.mean()), rel=1e-4)


def test_what_cameras_look_at_is_taken_for_an_object_only_if_asked_for_or_with_alpha():
    capture = scene(centers=ARC, axes=looking_at([0.0, 0.0, 0.0], ARC))
    surroundings, wide = random_box(capture)
    torch.testing.assert_close(surroundings, torch.tensor(ARC).mean(0))
    assert random_box(capture, "surroundings")[1] == wide
    middle, narrow = random_box(capture, "object")
    assert float(middle.norm()) < 1e-5
    assert narrow < wide / 3


def test_cameras_that_look_past_each_other_away_or_in_parallel_look_at_no_point():
    away = -looking_at([0.0, 0.0, 0.0], ARC)
    parallel = torch.tensor([[0.0, 0.0, 1.0]]).expand(4, 3)
    past = looking_at([0.0, 0.0, 0.0], ARC)[torch.tensor([1, 2, 3, 0])]
    for axes in (away, parallel, past, None):
        assert focus(scene(centers=ARC, axes=axes)) is None
    assert focus(scene(centers=ARC[:1], axes=looking_at([0.0, 0.0, 0.0], ARC[:1]))) is None


def test_random_points_fill_the_box_and_follow_the_seed():
    capture = scene()
    points, colors = random_points(capture, 5000, torch.Generator().manual_seed(1))
    center, half = random_box(capture)
    inside = (points - center).abs()
    assert bool((inside <= half).all())
    assert bool((inside.amax(0) > 0.99 * half).all())
    assert 0 <= float(colors.min()) < float(colors.max()) <= 1
    again, _ = random_points(capture, 5000, torch.Generator().manual_seed(1))
    assert torch.equal(points, again)


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_splats_of_a_file_come_back_as_they_were(degree):
    splats = random_splats(12, degree=1)
    start = from_splats(splats, degree)
    torch.testing.assert_close(start.log_scales.exp(), splats.scales)
    torch.testing.assert_close(start.opacity_logits.sigmoid(), splats.opacities)
    assert start.sh.shape == (12, (degree + 1) ** 2, 3)
    assert isinstance(splats.colors, Sh)
    common = min(4, start.sh.shape[1])
    assert torch.equal(start.sh[:, :common], splats.colors.coefficients[:, :common])
    assert not start.sh[:, common:].any()


def test_saturated_opacities_and_flat_splats_of_a_file_stay_finite():
    splats = Splats(
        means=torch.zeros(2, 3),
        opacities=torch.tensor([0.0, 1.0]),
        colors=Sh(torch.zeros(2, 1, 3), 0),
        quats=torch.ones(2, 4),
        scales=torch.tensor([[0.0, 0, 0], [1, 0, 1]]),
    )
    start = from_splats(splats, 0)
    assert bool(start.opacity_logits.isfinite().all())
    assert bool(start.log_scales.isfinite().all())


def test_a_file_that_cannot_be_started_from_is_refused():
    with pytest.raises(DataError, match="init: the file contains no splats"):
        from_splats(random_splats(0), 1)
    broken = random_splats(3)
    broken.means[1, 2] = float("nan")
    with pytest.raises(DataError, match="init: the means of the file hold values that are not"):
        from_splats(broken, 1)
