"""What is said of points whose dependence on the view is known."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from support.track_observations import NOISE, exposed, highlight, lobe, observed

from gsfw.core.maths.spherical_harmonics import num_coefficients, sh_basis
from gsfw.preparation.check.view_dependence import (
    DEGREES,
    MIN_POINTS,
    ViewDependence,
    degree_errors,
)


def test_matte_points_with_noise_need_one_colour():
    found = ViewDependence.of(observed())
    assert found.shares[0] > 0.98
    assert sum(found.gains) < 0.05
    assert np.median(found.deviation) == pytest.approx(NOISE, rel=0.05)
    assert found.advice().endswith("sh_degree=0 will lose little.")


def test_a_few_strong_highlights_keep_degree_0_from_being_advised():
    def rare(points, cosines):
        return 2 * np.where(points % 16 == 1, highlight(points, cosines), 0.0)

    found = ViewDependence.of(observed(rare))
    assert found.shares[0] > 0.9
    assert "sh=adaptive" in found.advice()


def test_soft_lobes_ask_for_degree_1():
    found = ViewDependence.of(observed(lobe, views=24))
    assert found.shares[1] > 0.95
    assert found.gains[0] > 10
    assert found.gains[1] < 0.1
    assert found.by_chance < 0.05
    assert found.advice().endswith("sh_degree=1 will lose little.")


def test_highlights_ask_for_degree_2_where_they_are():
    found = ViewDependence.of(observed(highlight))
    shining = np.arange(len(found.degrees)) % 2 == 1
    assert (found.degrees[shining] == 2).mean() > 0.7
    assert (found.degrees[~shining] == 0).mean() > 0.9
    assert min(found.gains) > 1.5
    assert "sh=adaptive" in found.advice()


def test_colours_at_random_are_no_view_dependence():
    found = ViewDependence.of(observed(noise=20 / 255))
    assert found.shares[0] > 0.98
    assert found.by_chance < 0.02


def test_exposure_is_no_view_dependence():
    plain, found = ViewDependence.of(observed()), ViewDependence.of(exposed(observed())[0])
    assert found.shares[0] > 0.98
    assert np.median(found.deviation) == pytest.approx(np.median(plain.deviation), rel=0.05)
    assert np.median(found.exposed) > 5 * np.median(found.deviation)
    assert found.drifts
    assert not plain.drifts


def test_lobes_are_found_under_exposure():
    assert ViewDependence.of(exposed(observed(lobe, views=24))[0]).shares[1] > 0.95


@pytest.mark.parametrize(("texture", "matte"), [(50.0, True), (2.0, False)])
def test_points_that_are_off_in_depth_are_matte_on_a_texture(texture, matte):
    """They drift over it from side to side, which looks like a lobe; by how much is known."""
    colors = observed(lobe, views=24)
    variance = (texture / 255) ** 2
    drifting = replace(colors, misplaced=np.full(len(colors.points), variance))
    assert (ViewDependence.of(drifting).shares[0] == 1.0) == matte


def test_too_few_points_are_not_judged():
    assert ViewDependence.of(observed(points=MIN_POINTS - 1)) is None
    assert ViewDependence.of(observed(points=MIN_POINTS)) is not None


def test_the_document_is_in_grey_levels_and_its_shares_add_up():
    document = ViewDependence.of(observed(lobe, noise=4 / 255)).document()
    assert document["points"] == 240
    assert document["matte"] + document["degree_1"] + document["degree_2"] == pytest.approx(1)
    assert 10 < document["deviation"] < 20
    assert document["deviation_if_misplaced"] == 0


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


def test_too_few_images_for_a_degree_are_an_infinite_error():
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
