"""The motion of every method in closed form: exact where it is of that form, else within bounds."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from support.moving_models import IN_CLOSED_FORM, MODELS, TENTHS
from support.moving_scene import two_balls
from support.moving_splats import at, moving_scene, spacetime
from support.scenes import random_splats

from gsfw.core.column import Column
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.core.model import PrimitiveModel
from gsfw.core.motion import fit
from gsfw.core.motion.evaluation import in_world, splats_at
from gsfw.core.motion.fit import fit_motion, instants
from gsfw.core.motion.poses import Bounds
from gsfw.core.numerics import DEFAULT
from gsfw.core.splats import Splats
from gsfw.methods.moving.covariances import covariances

SCENE = replace(moving_scene(), time_range=(3.0, 5.0))
BETWEEN = (0.013, 0.333, 0.72, 0.951)
"""Times at which no sample is taken."""


def fitted(model, **options):
    return fit_motion(model, SCENE, TENTHS, **options)


def seen(splats):
    return splats.take((splats.opacities >= DEFAULT.alpha_min).nonzero()[:, 0])


def shapes(splats):
    if splats.covariances is not None:
        return splats.covariances.double()
    return covariances(splats.quats.double(), splats.scales.double())


def differences(model, file, time):
    """Largest differences of position (in sizes), shape and opacity, of splats that are seen.

    Those of position and shape times the opacity: what is nearly gone may be less exact.
    """
    truth, found = seen(model.splats(at(time))), seen(splats_at(file, time))
    apart = torch.cdist(found.means, truth.means.double()).min(1)
    assert len(found)
    expected = shapes(truth)[apart.indices]
    sizes, opacities = expected.det().pow(1 / 6), truth.opacities[apart.indices]
    changes = (shapes(found) - expected).flatten(1).norm(dim=1) / expected.flatten(1).norm(dim=1)
    return (
        float((opacities * apart.values / sizes).max()),
        float((opacities * changes).max()),
        float((found.opacities - opacities).abs().max()),
    )


PLAIN = ("spacetime", "of degree 5", "rotor4d", "mlp", "dynamic3d")
"""The others are variants of these."""


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=() if name in PLAIN else pytest.mark.slow) for name in MODELS],
)
def moving(request):
    model = MODELS[request.param]().requires_grad_(False)
    return request.param, model, fitted(model)


def test_motion_of_the_form_of_files_is_found_again_to_rounding_and_any_other_within_bounds(moving):
    name, model, fit = moving
    exact = name in IN_CLOSED_FORM
    if exact:
        assert len(fit.file.content.splats) == fit.num_rows
        assert not fit.file.has_pieces
    assert fit.num_rows + fit.num_unseen == model.num_rows
    for time in BETWEEN if exact else TENTHS:
        position, shape, opacity = differences(model, fit.file, time)
        bounds = Bounds(0.0)
        assert position < (1e-4 if exact else bounds.position)
        assert shape < (1e-5 if exact else bounds.shape)
        assert opacity < (1e-5 if exact else bounds.opacity)


def test_no_more_than_what_is_seen_is_there(moving):
    name, model, fit = moving
    for time in BETWEEN if name in IN_CLOSED_FORM else TENTHS:
        assert len(seen(splats_at(fit.file, time))) == len(seen(model.splats(at(time))))


@pytest.mark.parametrize("name", ["of degree 5", "dynamic3d"])
def test_formats_without_intervals_get_one_piece_for_each_row(name):
    fit = fitted(MODELS[name](), cuts=False)
    assert len(fit.file.content.splats) == fit.num_rows
    assert not fit.file.has_pieces
    assert fit.file.motion_file(pieces=False) is fit.file


def test_what_stands_has_no_motion_at_all_and_a_straight_path_no_more_than_that():
    motion = fitted(two_balls()).file.motion
    assert motion.path[0, 0].tolist() == pytest.approx([0.8, 0, 0], abs=1e-6)
    assert float(motion.path[0, 1:].abs().max()) < 1e-5
    for values in (motion.path[1], motion.spin, motion.growth):
        assert torch.count_nonzero(values) == 0
    assert motion.width.tolist() == [torch.inf, torch.inf]


def test_the_file_says_what_the_scene_and_the_run_are():
    file = fitted(spacetime(), antialiased=True).file
    assert (file.time_range, file.frames, file.is_still) == ((3.0, 5.0), 11, False)
    assert file.content.antialiased
    assert file.content.splats.colors.coefficients.shape[1:] == (4, 3)


def test_colours_that_change_are_those_of_the_middle_and_their_change_is_told():
    with torch.no_grad():
        fit = fitted(MODELS["hexplane"]())
        still = fitted(spacetime())
    assert fit.recolored > 0.005
    assert still.recolored == 0


def test_rows_that_are_not_finite_or_never_seen_are_left_out_and_counted():
    model = spacetime()
    with torch.no_grad():
        model.canonical.means.values[3, 1] = torch.nan
        model.canonical.opacity_logits.values[5] = -9.0
    fit = fitted(model)
    assert (fit.num_rows, fit.num_dropped, fit.num_unseen) == (18, 1, 1)
    assert fit.file.content.splats.means.isfinite().all()


def test_nothing_to_see_is_refused():
    model = spacetime()
    with torch.no_grad():
        model.canonical.opacity_logits.values.fill_(-9.0)
    with pytest.raises(ValueError, match="no splat is seen at any time"):
        fitted(model)


def test_parts_of_the_rows_give_what_all_of_them_give(monkeypatch):
    model = spacetime(motion_order=5)
    whole = fitted(model).file
    monkeypatch.setattr(fit, "MEMORY", 1)
    monkeypatch.setattr(fit, "BATCH", 3)
    parts = fitted(model).file
    for time in BETWEEN:
        one, other = splats_at(whole, time), splats_at(parts, time)
        first, second = (splats.means[:, 0].argsort() for splats in (one, other))
        torch.testing.assert_close(one.means[first], other.means[second])
        torch.testing.assert_close(
            one.colors.coefficients[first], other.colors.coefficients[second]
        )


class Turning(PrimitiveModel):
    """One splat by its covariance, which turns about z and stretches."""

    def __init__(self):
        super().__init__()
        self.scales = Column(torch.tensor([[0.1, 0.2, 0.4]], dtype=torch.float64))

    def columns(self):
        return {"scales": self.scales}

    def splats(self, time=None, cameras=None):
        turn = rotation_vector_matrices(torch.stack([time * 0, time * 0, 2 * time])[None])
        axes = turn * self.scales.values[:, None] * torch.exp(time * torch.tensor([0.0, 1.0, 0.0]))
        return Splats(
            means=torch.zeros(1, 3, dtype=torch.float64),
            opacities=torch.full((1,), 0.9, dtype=torch.float64),
            colors=random_splats(1, degree=0).colors,
            covariances=axes @ axes.transpose(1, 2),
        )


def test_covariances_that_turn_have_axes_that_follow_even_when_they_change_places():
    model = Turning()
    fit = fitted(model)
    assert len(fit.file.content.splats) <= 4
    for time in TENTHS:
        expected = shapes(model.splats(at(time)))[0]
        assert float((shapes(splats_at(fit.file, time))[0] - expected).norm()) < 0.1 * float(
            expected.norm()
        )


def test_a_file_in_another_frame_shows_the_splats_in_that_frame():
    file = fitted(spacetime()).file
    turn = rotation_vector_matrices(torch.tensor([[0.3, -1.0, 0.5]], dtype=torch.float64))[0]
    frame = Similarity(2.5, turn, torch.tensor([1.0, -7.0, 3.0], dtype=torch.float64))
    elsewhere = in_world(file, frame)
    for time in BETWEEN:
        expected, found = transform_splats(splats_at(file, time), frame), splats_at(elsewhere, time)
        torch.testing.assert_close(found.means, expected.means)
        torch.testing.assert_close(shapes(found), shapes(expected))
        torch.testing.assert_close(found.opacities, expected.opacities)
        torch.testing.assert_close(found.colors.coefficients, expected.colors.coefficients)


def test_instants_contain_the_times_of_the_data_and_are_not_too_few_or_too_near():
    for times in ((), (0.5,), TENTHS, [index / 299 for index in range(300)], (0.0, 1e-9, 0.4)):
        found = instants(times)
        gaps = [b - a for a, b in pairwise(found)]
        assert (found[0], found[-1]) == (0.0, 1.0)
        assert min(gaps) > 1e-4
        assert 33 <= len(found) <= 300
        assert all(min(abs(time - other) for other in found) < 2e-6 for time in times)
