"""Errors of spherical harmonics at colours that they have not seen."""

import numpy as np
import torch
from support.track_observations import lobe, observed

from gsfw.core.maths.spherical_harmonics import num_coefficients, sh_basis
from gsfw.preparation.check.view_dependence import DEGREES, degree_errors


def tensors(colors):
    return (torch.from_numpy(part) for part in (colors.points, colors.directions, colors.colors))


def test_errors_are_those_of_fits_without_the_colour_that_is_foretold():
    points, directions, values = tensors(observed(lobe, points=2))
    found = degree_errors(points, directions, values)
    for point in (0, 1):
        mine = points == point
        for degree in DEGREES:
            basis = sh_basis(2, directions[mine])[:, : num_coefficients(degree)]
            colors, misses = values[mine], []
            for left in range(len(colors)):
                rest = torch.arange(len(colors)) != left
                fit = torch.linalg.lstsq(basis[rest], colors[rest]).solution
                misses.append((basis[left] @ fit - colors[left]).square().mean())
            torch.testing.assert_close(found[point, degree], torch.stack(misses).mean())


def test_too_few_pictures_for_a_degree_are_an_infinite_error():
    points, directions, values = tensors(observed(points=3, views=16))
    found = degree_errors(points, directions, values)
    assert found[:, :2].isfinite().all()
    assert found[:, 2].isinf().all()


def test_cameras_on_a_circle_tell_fewer_coefficients_apart():
    angles = torch.linspace(0, 2 * np.pi, 13, dtype=torch.float64)[:-1]
    circle = torch.stack([angles.cos(), angles.sin(), torch.full_like(angles, 0.5)], dim=1)
    circle = circle / circle.norm(dim=1, keepdim=True)
    values = (2 * angles).cos()[:, None].expand(-1, 3)
    found = degree_errors(torch.zeros(12, dtype=torch.int64), circle, values)
    assert found[0, 0] > 0.5
    assert found[0, 2] < 1e-12
