"""Splines through poses."""

import math

import pytest
import torch

from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.rendering.splines import PoseSpline, hermite, interpolate


def poses_at(*places, turns=None):
    poses = torch.eye(4, dtype=torch.float64).repeat(len(places), 1, 1)
    poses[:, :3, 3] = torch.tensor(places, dtype=torch.float64)
    if turns is not None:
        vectors = torch.tensor([[0.0, turn, 0.0] for turn in turns], dtype=torch.float64)
        poses[:, :3, :3] = rotation_vector_matrices(vectors)
    return poses


CORNERS = ((0.0, 0, 0), (1.0, 0, 0), (1.0, 0, 3.0), (-1.0, 0, 3.0))


def test_a_path_passes_every_pose():
    poses = poses_at(*CORNERS, turns=(0.0, 1.0, 2.0, 3.0))
    spline = PoseSpline(poses)
    assert torch.allclose(spline.at(spline.knots), poses, atol=1e-9)


def test_frames_are_equally_far_apart():
    spline = PoseSpline(poses_at(*CORNERS))
    places = spline.at(spline.even_moments(50))[:, :3, 3]
    steps = places.diff(dim=0).norm(dim=1)
    assert float(steps.max() / steps.min()) < 1.05
    assert torch.allclose(places[[0, -1]], torch.tensor(CORNERS, dtype=torch.float64)[[0, -1]])


def test_velocities_have_no_jumps():
    spline = PoseSpline(poses_at(*CORNERS, turns=(0.0, 0.5, 2.0, 2.2)))
    fine = torch.linspace(0, float(spline.knots[-1]), 4001, dtype=torch.float64)
    velocity = spline.at(fine)[:, :3].diff(dim=0) * 4000
    assert float(velocity.diff(dim=0).abs().max()) < 0.05


def test_a_closed_path_comes_back_without_a_jump():
    spline = PoseSpline(poses_at(*CORNERS), closed=True)
    places = spline.at(spline.even_moments(60))[:, :3, 3]
    around = torch.cat([places, places[:2]])
    steps = around.diff(dim=0)
    assert float(steps.norm(dim=1).max() / steps.norm(dim=1).min()) < 1.1
    assert float(steps.diff(dim=0).norm(dim=1).max()) < 0.5 * float(steps.norm(dim=1).mean())


def test_the_shorter_way_round_is_taken():
    spline = PoseSpline(poses_at((0.0, 0, 0), (1.0, 0, 0), turns=(math.pi - 0.1, math.pi + 0.1)))
    middle = spline.at(spline.knots.mean()[None])[0, :3, :3]
    expected = rotation_vector_matrices(torch.tensor([[0.0, math.pi, 0.0]], dtype=torch.float64))
    assert torch.allclose(middle, expected[0], atol=1e-6)


def test_one_pose_and_equal_poses_stand_still():
    for count in (1, 3):
        poses = poses_at(*[(1.0, 2.0, 3.0)] * count)
        spline = PoseSpline(poses)
        found = spline.at(spline.even_moments(5))
        assert torch.allclose(found, poses[:1].expand(5, 4, 4))
    assert len(PoseSpline(poses_at((1.0, 2.0, 3.0)), closed=True).even_moments(4)) == 4


def test_straight_lines_do_not_overshoot():
    knots, values = torch.tensor([0.0, 1.0, 2.0]), torch.tensor([0.0, 1.0, 0.0])
    found = interpolate(values, knots, torch.tensor([-1.0, 0.25, 1.0, 1.5, 9.0]))
    assert found.tolist() == pytest.approx([0, 0.25, 1, 0.5, 0])


def test_knots_of_any_spacing_reproduce_a_parabola_inside():
    knots = torch.tensor([0.0, 1.0, 3.0, 3.5], dtype=torch.float64)
    found = hermite((knots**2)[:, None], knots, torch.tensor([1.5, 2.5], dtype=torch.float64))
    assert found[:, 0].tolist() == pytest.approx([2.25, 6.25])
