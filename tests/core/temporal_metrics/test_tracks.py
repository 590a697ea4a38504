"""Tracks: the paths of rows, and how far they are from true ones."""

import math

import pytest
import torch
from support.moving_scene import two_balls
from support.moving_splats import spacetime

from gsfw.core.temporal_metrics.tracks import Tracks, compare, follow


def straight(points: torch.Tensor, velocity: torch.Tensor, times: int = 3) -> torch.Tensor:
    """Points that move by ``velocity`` from each time to the next."""
    return points + velocity * torch.arange(times)[:, None, None]


def opaque(positions: torch.Tensor) -> Tracks:
    times = tuple(index / (len(positions) - 1) for index in range(len(positions)))
    return Tracks(times, positions, torch.ones(positions.shape[:2]))


def test_rows_are_followed_through_time():
    tracks = follow(two_balls(velocity=0.8), (0.0, 0.5, 1.0))
    assert tracks.times == (0.0, 0.5, 1.0)
    assert tracks.positions[:, 0, 0].tolist() == pytest.approx([-0.4, 0.0, 0.4])
    assert tracks.positions[:, 1].tolist() == [[0.0, 0.5, 0.0]] * 3
    assert bool(tracks.present.all())


def test_rows_that_are_not_there_have_no_place():
    model = spacetime(n=60)
    tracks = follow(model, (0.0, 0.5, 1.0))
    absent = ~tracks.present
    assert bool(absent.any())
    assert bool(tracks.positions[absent].isnan().all())
    assert bool(tracks.positions[tracks.present].isfinite().all())
    splats = model.splats(torch.tensor(0.5, dtype=torch.float64))
    assert splats.rows is not None
    assert torch.equal(tracks.positions[1, splats.rows], splats.means.detach())


def test_tracks_that_follow_exactly_have_no_error():
    points = torch.rand(20, 3, generator=torch.Generator().manual_seed(0))
    velocity = torch.where(points[:, :1] > 0.5, torch.tensor([0.1, 0.0, 0.0]), 0.0)
    truth = straight(points, velocity)
    found = compare(opaque(truth), truth, torch.ones(3, 20, dtype=torch.bool), 1e-3)
    assert (found.moving, found.still) == (0.0, 0.0)
    assert found.moved == pytest.approx(0.15, abs=0.051)
    assert found.relative == 0.0


def test_errors_are_those_of_the_nearest_row_that_is_opaque():
    truth = straight(
        torch.tensor([[0.0, 0, 0], [5.0, 0, 0]]), torch.tensor([[1.0, 0, 0], [0, 0, 0]])
    )
    rows = torch.tensor([[0.1, 0, 0], [0.01, 0, 0], [5.2, 0, 0]])
    paths = straight(rows, torch.tensor([[0.5, 0, 0], [1.0, 0, 0], [0, 0.25, 0]]))
    tracks = opaque(paths)
    tracks.opacities[1, 1] = 0.4
    found = compare(tracks, truth, torch.ones(3, 2, dtype=torch.bool), 1e-3)
    assert found.moving == pytest.approx(0.5), "the lower of two medians: 0.5 and 1"
    assert found.moved == pytest.approx(1.0)
    assert found.relative == pytest.approx(0.5)
    assert found.still == pytest.approx(0.25)


def test_points_that_come_and_go_are_left_out():
    truth = straight(torch.tensor([[0.0, 0, 0], [5.0, 0, 0]]), torch.tensor([[1.0, 0, 0]]))
    present = torch.tensor([[True, True], [True, False], [True, True]])
    paths = straight(
        torch.tensor([[0.0, 0, 0], [5.0, 0, 0]]), torch.tensor([[1.0, 0, 0], [9, 0, 0]])
    )
    found = compare(opaque(paths), truth, present, 1e-3)
    assert found.moving == 0.0
    assert math.isnan(found.still)
    nothing = compare(opaque(paths), truth, torch.zeros_like(present), 1e-3)
    assert math.isnan(nothing.moving)
    assert math.isnan(nothing.moved)


def test_a_single_time_says_nothing_of_motion():
    truth = torch.zeros(1, 2, 3)
    tracks = Tracks((0.0,), truth, torch.ones(1, 2))
    found = compare(tracks, truth, torch.ones(1, 2, dtype=torch.bool), 1e-3)
    assert math.isnan(found.moving)
    assert math.isnan(found.still)
