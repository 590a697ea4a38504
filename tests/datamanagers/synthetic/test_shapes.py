"""Rays meet each shape where it begins, and nowhere else."""

import pytest
import torch
from support.built_in_scene import INSIDE

from gsfw.datamanagers.synthetic.shapes import Box, Cone, Cylinder, Sphere


@pytest.mark.parametrize("kind", INSIDE)
def test_rays_stop_where_they_first_enter_a_shape_and_normals_face_them(kind):
    generator = torch.Generator().manual_seed(0)
    origins = torch.randn(3, 4000, generator=generator, dtype=torch.float64)
    origins = origins / origins.norm(dim=0) * 3
    aims = torch.rand(3, 4000, generator=generator, dtype=torch.float64) * 3 - 1.5
    directions = aims - origins
    distances = kind().distances(origins, directions)
    steps = torch.linspace(0, 2, 801, dtype=torch.float64)
    along = origins[:, :, None] + directions[:, :, None] * steps
    inside = (INSIDE[kind](along.reshape(3, -1)) < 0).view(4000, -1)
    met = distances.isfinite()
    assert bool(met.any())
    assert bool((~met).any())
    assert not bool(inside[~met].any())
    before = steps < distances[met][:, None] - 1e-9
    assert not bool((inside[met] & before).any())
    points = origins[:, met] + distances[met] * directions[:, met]
    assert float(INSIDE[kind](points).abs().max()) < 1e-9
    assert float((kind().normals(points) * directions[:, met]).sum(dim=0).max()) <= 1e-9


def test_rays_leaving_a_surface_do_not_meet_it_again():
    directions = torch.tensor([[0.1], [0.0], [1.0]])
    for shape in (Sphere(), Box(), Cylinder(), Cone()):
        assert not bool(
            shape.distances(torch.tensor([[0.0], [0.0], [1.001]]), directions).isfinite()
        )
