"""The network of frequencies: what it is given, and where it joins its input again."""

import pytest
import torch
from torch.nn.functional import linear, relu

from gsfw.methods.gaussians4d.config import MlpConfig
from gsfw.methods.gaussians4d.frequency import FrequencyMlp

SMALL = MlpConfig(width=7, depth=4, frequencies=2, time_frequencies=3)


def network(config: MlpConfig = SMALL) -> FrequencyMlp:
    return FrequencyMlp(config, torch.Generator().manual_seed(0)).double()


def encoded(values, count):
    parts = [values]
    for wave in (torch.sin, torch.cos):
        parts += [
            wave(2**k * values[axis]).view(1) for axis in range(len(values)) for k in range(count)
        ]
    return torch.cat(parts)


def test_features_are_those_of_the_layers_one_by_one():
    mlp, time = network(), torch.tensor(0.3, dtype=torch.float64)
    points = torch.rand(5, 3, dtype=torch.float64) * 2 - 1
    found = mlp(points, time)
    first, second = mlp.timing
    moment = second(relu(first(encoded(time.view(1), 3))))
    for point, features in zip(points, found, strict=True):
        given = torch.cat([encoded(point, 2), moment])
        hidden = given
        for depth, layer in enumerate(mlp.layers):
            hidden = torch.cat([given, hidden]) if depth == 2 else hidden
            hidden = relu(linear(hidden, layer.weight, layer.bias))
        torch.testing.assert_close(features, hidden)


def test_the_default_is_the_paper_s_network():
    mlp = network(MlpConfig())
    assert [layer.in_features for layer in mlp.layers] == [93, *[256] * 3, 349, *[256] * 3]
    assert {layer.out_features for layer in mlp.layers} == {256}
    assert mlp.features == 256
    assert mlp.detached
    assert mlp.grids() == ()


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_shallow_networks_work_too(depth):
    mlp = network(MlpConfig(width=5, depth=depth, frequencies=0, time_frequencies=0))
    assert mlp(torch.zeros(4, 3).double(), torch.tensor(0.5).double()).shape == (4, 5)


def test_layers_have_the_gradients_of_finite_differences():
    mlp, time = network(), torch.tensor(0.6, dtype=torch.float64)
    points = torch.rand(5, 3, dtype=torch.float64)
    parameters = tuple(mlp.parameters())
    assert torch.autograd.gradcheck(lambda *_: mlp(points, time), parameters, fast_mode=True)
