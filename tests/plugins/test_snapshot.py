"""Snapshots of models for files."""

import torch
from support.gaussians import gaussians, table_of
from support.scenes import random_splats

from gsfw.core.scene import Scene
from gsfw.plugins.snapshot import snapshot


def scene() -> Scene:
    points = random_splats(4, degree=0).means
    return Scene("a", points, points.abs(), points, 1.0)


def test_a_model_that_has_lost_all_rows_is_a_snapshot_without_any():
    model = gaussians(3)
    table_of(model)[1].keep(torch.zeros(3, dtype=torch.bool))
    taken = snapshot(model, scene(), False)
    assert len(taken.splats) == taken.num_dropped == 0


def test_rows_that_are_not_finite_are_left_out_and_counted():
    model = gaussians(5)
    with torch.no_grad():
        model.means.values[2, 1] = torch.inf
    taken = snapshot(model, scene(), False)
    assert (len(taken.splats), taken.num_dropped) == (4, 1)
