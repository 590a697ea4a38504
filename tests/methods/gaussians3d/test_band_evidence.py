"""Which colours need another band: told by the gradients that its coefficients would have."""

from dataclasses import replace

import pytest
import torch
from support.gaussians import context_of, gaussians
from support.scenes import front_camera, random_splats, turned_camera

from gsfw.core.cameras import Cameras
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.splats import Sh
from gsfw.methods.gaussians3d.band_evidence import BandEvidence
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

COUNT = 12
DEGREES = torch.arange(COUNT) % 3


def ragged(rows=None):
    """Splats of degrees 0 to 2 whose coefficients above that are zero, with gradients."""
    splats = random_splats(COUNT, degree=3, dtype=torch.float64)
    splats = replace(splats, colors=splats.colors.of_degrees(DEGREES), rows=rows)
    return splats.map(lambda tensor: tensor.detach().requires_grad_())


def room(degrees=DEGREES) -> BandEvidence:
    """Evidence with room for the next band of every row."""
    evidence = BandEvidence(len(degrees)).double()
    evidence.sums.assign(evidence.sums.resized(2 * degrees + 3))
    return evidence


def watched(splats, cameras: Cameras, evidence, degrees=DEGREES, weights=None):
    """Draw, and let gradients flow back; the pixels' weights in the loss."""
    output = ReferenceRasterizer().render(splats, cameras)
    context = context_of(output.statistics, len(degrees), splats=splats)
    context = replace(context, batch=replace(context.batch, cameras=cameras))
    if weights is None:
        weights = torch.randn(output.color.shape, dtype=torch.float64)
    evidence.watch(context, degrees)
    (output.color * weights).sum().backward()
    return weights


def next_band(gradient):
    """What is missing at each row's degree, one row after the other."""
    return torch.cat(
        [
            row[(d + 1) ** 2 : (d + 2) ** 2]
            for row, d in zip(gradient, DEGREES.tolist(), strict=True)
        ]
    )


@pytest.mark.parametrize("camera", [front_camera(dtype=torch.float64), turned_camera()])
def test_the_sums_are_the_gradients_of_coefficients_that_are_not_there(camera):
    splats, evidence = ragged(), room()
    weights = watched(splats, camera, evidence)
    whole = torch.zeros(COUNT, 16, 3, dtype=torch.float64)
    whole[:, : splats.colors.dense().shape[1]] = splats.colors.dense().detach()
    whole.requires_grad_()
    output = ReferenceRasterizer().render(replace(splats, colors=Sh(whole, 3)), camera)
    (output.color * weights).sum().backward()
    expected = next_band(whole.grad)
    assert float(expected.abs().max()) > 0
    torch.testing.assert_close(evidence.sums.values[:, 0], expected)
    torch.testing.assert_close(evidence.sums.values[:, 1], expected.square())
    torch.testing.assert_close(evidence.weights.values, whole.grad[:, 0].abs().sum(1) / C0)


def test_views_add_up_and_rows_are_found_through_those_drawn():
    rows = torch.arange(COUNT).flip(0)
    camera = turned_camera()
    once, twice = room(), room()
    weights = watched(ragged(), camera, once)
    for _ in range(2):
        watched(ragged(), camera, twice, weights=weights)
    torch.testing.assert_close(twice.sums.values, 2 * once.sums.values)
    splats = ragged()
    turned = replace(splats.take(rows), rows=rows)
    turned = turned.map(lambda tensor: tensor.detach().requires_grad_())
    found = room()
    watched(turned, camera, found, weights=weights)
    torch.testing.assert_close(found.sums.values, once.sums.values)
    torch.testing.assert_close(found.weights.values, once.weights.values)


def test_splats_that_two_cameras_of_a_batch_see_count_for_weights_only():
    front = front_camera(dtype=torch.float64)
    evidence = room()
    watched(ragged(), front.select([0, 0]), evidence)
    assert float(evidence.sums.values.abs().max()) == 0
    assert float(evidence.weights.values.max()) > 0


def test_without_room_only_weights_are_gathered():
    evidence = BandEvidence(COUNT).double()
    watched(ragged(), front_camera(dtype=torch.float64), evidence)
    assert evidence.sums.values.numel() == 0
    assert float(evidence.weights.values.max()) > 0
    evidence.forget_()
    assert float(evidence.weights.values.max()) == 0


@pytest.mark.parametrize("wrong", [torch.nan, torch.inf, -torch.inf])
def test_a_step_that_is_not_finite_is_no_evidence(wrong):
    camera, evidence = front_camera(dtype=torch.float64), room()
    weights = watched(ragged(), camera, evidence)
    before = evidence.sums.values.clone(), evidence.weights.values.clone()
    weights[0, 20, 20] = wrong
    watched(ragged(), camera, evidence, weights=weights)
    assert torch.equal(evidence.sums.values, before[0])
    assert torch.equal(evidence.weights.values, before[1])


def test_huge_gradients_leave_finite_evidence():
    camera, evidence = front_camera(dtype=torch.float64), room().float()
    splats = ragged().map(lambda tensor: tensor.detach().float().requires_grad_())
    weights = torch.full((1, camera.height, camera.width, 3), 1e30)
    watched(splats, camera.to(dtype=torch.float32), evidence, weights=weights)
    assert bool(evidence.sums.values.isfinite().all())
    assert bool(evidence.weights.values.isfinite().all())


def test_noise_needs_no_band_and_what_depends_on_the_direction_does():
    generator = torch.Generator().manual_seed(1)
    evidence = room(torch.zeros(200, dtype=torch.int64))
    pulls = torch.randn(50, 600, 1, 3, generator=generator, dtype=torch.float64)
    for view in pulls:
        term = view.view(200, 3, 3).clone()
        term[:20] += 0.6  # The first rows are pulled the same way by all.
        values = torch.stack([term, term.square()], dim=2)
        evidence.sums.values.add_(values.flatten(0, 1))
    needed = evidence.needed(2.0)
    assert bool(needed[:20].all())
    assert int(needed[20:].sum()) <= 15, "of noise 4 % is above 2, by the law of chi squared"


def test_rows_without_evidence_need_nothing():
    assert not bool(BandEvidence(5).needed(1.0).any())


def test_splats_without_a_graph_are_not_watched():
    splats = random_splats(4, degree=1)
    evidence = BandEvidence(4)
    output = ReferenceRasterizer().render(splats, front_camera())
    evidence.watch(context_of(output.statistics, 4, splats=splats), torch.zeros(4).long())
    model = gaussians(4)
    assert model.evidence is None
    assert model.regularizers(context_of(output.statistics, 4, splats=splats)) == {}
