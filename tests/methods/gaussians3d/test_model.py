"""Static Gaussians: activations, and what strategies ask of them."""

import math

import pytest
import torch
from support.scenes import random_splats

from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.operators import Operators
from gsfw.core.splats import Sh
from gsfw.methods.gaussians3d.config import StaticGaussiansOptim
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import (
    MAX_LOG_SCALE,
    MIN_LOG_SCALE,
    GaussianParameters,
    StaticGaussians,
)


def gaussians(n: int = 20, degree: int = 2, seed: int = 0) -> StaticGaussians:
    start = from_splats(random_splats(n, degree=degree, seed=seed), degree)
    return StaticGaussians(start, StaticGaussiansOptim().learning_rates(1.0))


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def covariance(model, row):
    turn = rotation_matrices(model.quats.values[row].detach()[None])[0]
    scales = model.log_scales.values[row].detach().exp()
    return turn @ torch.diag(scales**2) @ turn.T


def test_a_model_of_splats_draws_these_splats():
    splats = random_splats(20, degree=2)
    drawn = gaussians().splats()
    torch.testing.assert_close(drawn.means, splats.means)
    torch.testing.assert_close(drawn.quats, splats.quats)
    torch.testing.assert_close(drawn.scales, splats.scales)
    torch.testing.assert_close(drawn.opacities, splats.opacities)
    assert isinstance(drawn.colors, Sh)
    assert isinstance(splats.colors, Sh)
    torch.testing.assert_close(drawn.colors.dense(), splats.colors.dense())
    assert drawn.rows is None


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_only_active_bands_are_drawn_and_trained(degree):
    model = gaussians(degree=3)
    model.active_degree = degree
    colors = model.splats().colors
    assert isinstance(colors, Sh)
    assert colors.degree == degree
    assert colors.dense().shape == (20, (degree + 1) ** 2, 3)
    assert model.active_bands() == (degree + 1) ** 2 - 1
    colors.dense().sum().backward()
    assert model.sh_dc.values.grad is not None
    assert model.sh_rest is not None
    if degree == 0:
        assert model.sh_rest.values.grad is None
    else:
        assert model.sh_rest.values.grad is not None
        trained = model.sh_rest.values.grad.any(dim=2).any(dim=0)
        assert trained.tolist() == [band < (degree + 1) ** 2 - 1 for band in range(15)]


def test_degree_zero_has_no_further_bands():
    model = gaussians(degree=0)
    assert "sh_rest" not in model.columns()
    assert isinstance(model.splats().colors, Sh)
    other = gaussians(n=3, degree=0)
    other.load_state_dict(model.state_dict())
    assert other.num_rows == 20


def test_one_row_and_no_row_make_splats():
    for n in (0, 1):
        start = GaussianParameters(
            torch.zeros(n, 3), torch.zeros(n, 4), torch.zeros(n, 3), torch.zeros(n),
            torch.zeros(n, 4, 3),
        )  # fmt: skip
        model = StaticGaussians(start, StaticGaussiansOptim().learning_rates(1.0))
        assert len(model.splats()) == model.num_rows == n
        model.perturb_(1.0, generator(), Operators())
        model.project_()
        assert model.opacities().shape == model.sizes().shape == (n,)


def test_sizes_are_the_largest_deviations():
    model = gaussians()
    scales = model.splats().scales
    assert scales is not None
    torch.testing.assert_close(model.sizes(), scales.amax(1).detach())


def test_children_of_a_split_are_drawn_from_their_gaussian():
    model = gaussians(n=3)
    rows, copies = torch.tensor([2, 0]), 40_000
    children = model.split_rows(rows, copies, generator())
    means = children["means"].values.view(copies, 2, 3)
    for position, row in enumerate([2, 0]):
        cloud, expected = means[:, position], covariance(model, row)
        assert (cloud.mean(0) - model.means.values[row]).norm() < 0.03 * model.sizes()[row]
        assert (torch.cov(cloud.T) - expected).norm() < 0.03 * expected.norm()


def test_children_of_a_split_are_smaller_and_otherwise_alike():
    model = gaussians()
    rows = torch.tensor([4, 9, 1])
    children = model.split_rows(rows, 2, generator())
    twice = torch.tensor([4, 9, 1, 4, 9, 1])
    for name in ("quats", "opacity_logits", "sh_dc", "sh_rest"):
        assert torch.equal(children[name].values, model.columns()[name].values[twice])
    shrunk = children["log_scales"].values.exp()
    torch.testing.assert_close(shrunk, model.log_scales.values[twice].exp().detach() / 1.6)


def test_relocated_rows_look_as_before_and_keep_everything_else():
    model = gaussians()
    rows, counts = torch.tensor([3, 8]), torch.tensor([2, 5])
    changed = model.relocated(rows, counts)
    one = 1 - changed["opacity_logits"].values.sigmoid()
    torch.testing.assert_close(1 - one**counts, model.opacities()[rows])
    for name in ("means", "quats", "sh_dc", "sh_rest"):
        assert torch.equal(changed[name].values, model.columns()[name].values[rows])
    ratios = (changed["log_scales"].values - model.log_scales.values[rows]).exp()
    assert bool((ratios < 1).all())
    torch.testing.assert_close(ratios, ratios[:, :1].expand(2, 3))


def test_noise_has_the_squared_covariance_of_each_row_and_spares_opaque_ones():
    n = 30_000
    one = gaussians(n=1)
    start = GaussianParameters(
        means=torch.zeros(n, 3),
        quats=one.quats.values.detach().repeat(n, 1),
        log_scales=one.log_scales.values.detach().repeat(n, 1),
        opacity_logits=torch.full((n,), math.log(0.005 / 0.995)),
        sh=torch.zeros(n, 1, 3),
    )
    model = StaticGaussians(start, StaticGaussiansOptim().learning_rates(1.0))
    with torch.no_grad():
        model.opacity_logits.values[0] = 0.0
    model.perturb_(2.0, generator(), Operators())
    assert float(model.means.values[0].detach().norm()) < 1e-12
    # At the threshold the sigmoid is one half, so that the noise is Sigma times a unit normal.
    sigma = covariance(one, 0)
    expected = sigma @ sigma
    assert (torch.cov(model.means.values.detach()[1:].T) - expected).norm() < 0.05 * expected.norm()


def test_lowered_opacities_are_capped_and_named():
    model = gaussians()
    before = model.opacities()
    assert model.change_opacities_(lambda values: values.clamp_max(0.3)) == ("opacity_logits",)
    torch.testing.assert_close(model.opacities(), before.clamp_max(0.3))


def test_projection_keeps_scales_in_range():
    model = gaussians(n=2)
    with torch.no_grad():
        model.log_scales.values[0] = 500.0
        model.log_scales.values[1] = -500.0
    model.project_()
    assert bool((model.log_scales.values[0] == MAX_LOG_SCALE).all())
    assert bool((model.log_scales.values[1] == MIN_LOG_SCALE).all())
    scales = model.splats().scales
    assert scales is not None
    assert bool((scales.isfinite() & (scales > 0)).all())


def test_the_same_seed_gives_the_same_children():
    model = gaussians()
    rows = torch.arange(10)
    first = model.split_rows(rows, 2, generator(3))["means"].values
    again = model.split_rows(rows, 2, generator(3))["means"].values
    other = model.split_rows(rows, 2, generator(4))["means"].values
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
