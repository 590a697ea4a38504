"""Paths through the views of a capture."""

import torch

from gsfw.core.maths.camera_path import look_at
from gsfw.rendering.paths import in_turn


def ring(count):
    angles = torch.arange(count, dtype=torch.float64) * 2 * torch.pi / count
    places = torch.stack([angles.cos(), angles.sin(), torch.zeros(count).double()], dim=1)
    up = torch.tensor([0.0, 0.0, 1.0]).double()
    return torch.linalg.inv(look_at(places, torch.zeros(3).double(), up))


def length(poses):
    return float(poses[:, :3, 3].diff(dim=0).norm(dim=1).sum())


def test_views_of_a_capture_keep_their_order():
    poses = ring(24)
    assert torch.equal(in_turn(poses), poses)
    zigzag = poses[[index + 1 - 2 * (index % 2) for index in range(24)]]
    assert torch.equal(in_turn(zigzag), zigzag)


def test_views_in_random_order_are_passed_one_after_the_other():
    poses = ring(24)
    shuffled = poses[torch.randperm(24, generator=torch.Generator().manual_seed(0))]
    assert length(shuffled) > 20
    found = in_turn(shuffled)
    assert length(found) < 9
    assert torch.equal(found[0], shuffled[0])
    assert len({tuple(pose[:3, 3].tolist()) for pose in found}) == 24


def test_one_view_is_in_order():
    assert len(in_turn(ring(1))) == 1
