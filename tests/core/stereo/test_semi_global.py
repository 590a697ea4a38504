"""Semi-global matching: what pixels without evidence take from their neighbours."""

import pytest
import torch

from gsfw.core.stereo.semi_global import aggregate, best_plane

PLANES, HEIGHT, WIDTH = 12, 5, 9
GREY = torch.full((HEIGHT, WIDTH), 0.5)


def costs_at(plane: int) -> torch.Tensor:
    costs = torch.ones(PLANES, HEIGHT, WIDTH)
    costs[plane] = 0.0
    return costs


def test_costs_that_agree_keep_their_plane():
    assert (aggregate(costs_at(4), GREY).argmin(0) == 4).all()


def test_pixels_without_evidence_take_the_plane_of_their_neighbours():
    costs = costs_at(7)
    costs[:, 1:4, 2:7] = 0.5
    assert (aggregate(costs, GREY).argmin(0) == 7).all()


def test_depths_jump_at_edges_of_the_image():
    costs, image = costs_at(2), torch.zeros(HEIGHT, WIDTH)
    costs[:, :, 5:] = costs_at(9)[:, :, 5:]
    image[:, 5:] = 1.0
    planes = aggregate(costs, image).argmin(0)
    assert (planes[:, :5] == 2).all()
    assert (planes[:, 5:] == 9).all()


def test_the_best_plane_lies_between_planes():
    places = torch.arange(PLANES, dtype=torch.float32)
    costs = ((places - 3.3) ** 2)[:, None, None].expand(PLANES, 2, 2)
    assert best_plane(costs).flatten().tolist() == pytest.approx([3.3] * 4, abs=1e-4)


def test_the_first_plane_has_none_before_it():
    places = torch.arange(PLANES, dtype=torch.float32)[:, None, None].expand(PLANES, 2, 2)
    assert best_plane(places).flatten().tolist() == [0.0] * 4
