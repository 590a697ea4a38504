"""A model renders with rounded columns, is trained through them, and keeps its own values."""

import torch
from support.states import assert_same_bits

from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.rounded_model import RoundedModel
from gsfw.methods.gaussians3d.model import GaussianParameters, StaticGaussians

STEPS = {"means": 0.25, "sh_rest": 0.5}


def rounded(name, values):
    step = STEPS.get(name)
    return values.detach() if step is None else (values.detach() / step).round() * step


def some_gaussians(count=20):
    generator = torch.Generator().manual_seed(0)
    shapes = {"means": (3,), "quats": (4,), "log_scales": (3,), "opacity_logits": (), "sh": (4, 3)}
    start = {
        name: torch.randn(count, *shape, generator=generator) for name, shape in shapes.items()
    }
    names = (*(name for name in shapes if name != "sh"), "sh_dc", "sh_rest")
    return StaticGaussians(GaussianParameters(**start), dict.fromkeys(names, LearningRate(0.1)))


def test_splats_are_made_of_rounded_values_and_the_columns_keep_theirs():
    model = some_gaussians()
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    usual, seen = model.splats(), RoundedModel(model, rounded).splats()
    assert torch.equal(seen.means, (before["means.values"] / 0.25).round() * 0.25)
    assert not torch.equal(seen.means, usual.means)
    assert torch.equal(seen.colors.rest, (before["sh_rest.values"] / 0.5).round() * 0.5)
    assert torch.equal(seen.quats, usual.quats)
    assert_same_bits(dict(model.state_dict()), before)
    assert torch.equal(model.splats().means, usual.means)


def test_gradients_are_those_at_the_rounded_values_and_reach_the_columns():
    model = some_gaussians()
    RoundedModel(model, rounded).splats().means.square().sum().backward()
    expected = 2 * rounded("means", model.means.values)
    assert torch.equal(model.means.values.grad, expected)
    assert not torch.equal(expected, 2 * model.means.values.detach())
