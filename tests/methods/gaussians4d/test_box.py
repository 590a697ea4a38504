"""The box around the initial points, and what becomes of space beyond it."""

import pytest
import torch

from gsfw.methods.gaussians4d.box import MARGIN, SHELL, SpaceBox


def cloud(n: int = 2000, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    sizes = torch.tensor([1.0, 2.0, 0.5], dtype=dtype)
    return (2 * torch.rand(n, 3, generator=generator, dtype=dtype) - 1) * sizes + 3.0


def test_the_box_holds_the_points_with_a_margin():
    points = cloud()
    box = SpaceBox(points, 1.0)
    torch.testing.assert_close(box.center, torch.full((3,), 3.0).double(), atol=0.05, rtol=0)
    expected = (1 + MARGIN) * torch.tensor([1.0, 2.0, 0.5]).double()
    torch.testing.assert_close(box.reach, expected, atol=0, rtol=0.05)
    assert float(box.size) == pytest.approx(2 * (1 + MARGIN), rel=0.05)
    inside = (points - box.center) / box.reach / (1 + SHELL)
    assert torch.equal(box(points), inside)


def test_a_few_stray_points_do_not_make_it_huge():
    points = cloud()
    strayed = points.clone()
    strayed[:10] = 1e5
    torch.testing.assert_close(
        SpaceBox(strayed, 1.0).reach, SpaceBox(points, 1.0).reach, atol=0, rtol=0.05
    )


def test_space_beyond_stays_apart_in_order_and_within_reach():
    box = SpaceBox(cloud(), 1.0)
    far = torch.zeros(200, 3, dtype=torch.float64)
    far[:, 0] = torch.logspace(0, 6, 200, dtype=torch.float64)
    for points in (far, -far):
        places = box(points + box.center)[:, 0].abs()
        assert bool((places.diff() > 0).all())
        assert float(places[-1]) < 1
    assert torch.equal(box(far)[:, 1], box(far)[:, 1][:1].expand(200))


def test_places_change_smoothly_through_the_walls():
    box = SpaceBox(cloud(), 1.0)
    walls = box.center + box.reach * torch.tensor([[1.0, -1.0, 1.0]]).double()
    step = 1e-6 * box.reach
    inwards, outwards = box(walls - step), box(walls + step)
    torch.testing.assert_close(inwards, outwards, atol=1e-5, rtol=0)
    slopes = [
        torch.autograd.functional.jacobian(lambda p: box(p).sum(), walls + side)
        for side in (-step, step)
    ]
    torch.testing.assert_close(slopes[0], slopes[1], atol=0, rtol=1e-3)
    anywhere = cloud(20).mul(3).requires_grad_()
    assert torch.autograd.gradcheck(box, anywhere)


def test_points_at_the_end_of_float32_have_finite_places_and_gradients():
    points = torch.tensor([[1e30, -1e30, 0.0], [1e38, 3.0, -1e38]], requires_grad=True)
    box = SpaceBox(cloud(dtype=torch.float32), 1.0)
    places = box(points)
    places.sum().backward()
    assert points.grad is not None
    assert bool(places.isfinite().all() & points.grad.isfinite().all())
    assert float(places.detach().abs().max()) <= 1


@pytest.mark.parametrize("points", [torch.zeros(0, 3), torch.ones(1, 3), torch.ones(5, 3)])
def test_without_extent_the_box_has_that_of_the_scene(points):
    box = SpaceBox(points, 2.5)
    reach = 2.5 * (1 + MARGIN) if len(points) == 0 else 2.5
    torch.testing.assert_close(box.reach, torch.full((3,), reach))
    assert torch.equal(box.center, torch.full((3,), float(len(points) > 0)))


def test_points_of_a_wall_still_make_a_box_with_depth():
    points = cloud()
    points[:, 2] = 7.0
    box = SpaceBox(points, 1.0)
    assert float(box.reach[2]) == pytest.approx(0.1 * float(box.reach.max()))
    assert bool(box(points).isfinite().all())
