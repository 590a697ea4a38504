"""The decoder: hidden layers of each quantity or none, and outputs that begin at zero."""

import pytest
import torch
from torch import Tensor
from torch.nn.functional import linear, relu

from gsfw.core.operators import Operators
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.methods.gaussians4d.decoder import Decoder, HiddenLayers

OUTPUTS = {"means": 3, "quats": 4}


def decoder(layers: HiddenLayers, seed: int = 0) -> Decoder:
    return Decoder(6, layers, OUTPUTS, Operators(), torch.Generator().manual_seed(seed))


def trained(layers: HiddenLayers) -> Decoder:
    model = decoder(layers)
    for output in model.outputs.values():
        torch.nn.init.normal_(output.weight)
        torch.nn.init.normal_(output.bias)
    return model


@pytest.mark.parametrize("depth", [0, 1, 3])
@pytest.mark.parametrize("head_width", [0, 2])
def test_outputs_begin_at_zero_whatever_is_given(depth, head_width):
    found = decoder(HiddenLayers(5, depth, head_width))(1e6 * torch.randn(9, 6))
    assert {name: value.shape for name, value in found.items()} == {
        "means": (9, 3), "quats": (9, 4),
    }  # fmt: skip
    assert all(not value.any() for value in found.values())


def test_each_quantity_has_a_hidden_layer_of_its_own():
    model = trained(HiddenLayers(5, 2, 3))
    given = torch.randn(4, 6)
    first, second = model.shared
    features = relu(second(relu(first(given))))
    assert model.hidden is not None
    for index, (name, output) in enumerate(model.outputs.items()):
        rows = slice(3 * index, 3 * index + 3)
        hidden = relu(linear(features, model.hidden.weight[rows], model.hidden.bias[rows]))
        torch.testing.assert_close(model(given)[name], output(hidden))


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_without_hidden_layers_of_their_own_quantities_are_linear_in_the_shared_layers(depth):
    model = trained(HiddenLayers(5, depth, 0))
    features = given = torch.randn(4, 6)
    for layer in model.shared:
        features = relu(layer(features))
    for name, output in model.outputs.items():
        torch.testing.assert_close(model(given)[name], output(features))


@pytest.mark.parametrize("head_width", [0, 16])
def test_native_decoders_and_all_their_gradients_are_those_of_torch(head_width):
    found = [flows(operators, head_width) for operators in (CpuOperators(), Operators())]
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-11)


def flows(operators: Operators, head_width: int) -> list[Tensor]:
    """Outputs, and gradients of inputs and parameters, of which some rows have none."""
    generator = torch.Generator().manual_seed(0)
    layers = HiddenLayers(32, 1, head_width)
    model = Decoder(16, layers, {**OUTPUTS, "sh": 12}, operators, generator).double()
    for parameter in model.outputs.parameters():
        torch.nn.init.normal_(parameter, generator=generator)
    given = torch.randn(70, 16, generator=generator, dtype=torch.float64, requires_grad=True)
    found = list(model(given).values())
    weights = torch.randn(70, 1, generator=generator, dtype=torch.float64)
    weights[::3] = 0
    sum((value * weights).square().sum() for value in found).backward()
    return [value.detach() for value in found] + [
        leaf.grad for leaf in (given, *model.parameters())
    ]


def test_the_same_seed_draws_the_same_layers_and_leaves_torch_s_generator_alone():
    layers = HiddenLayers(5, 1, 5)
    before = torch.get_rng_state()
    first, again, other = decoder(layers), decoder(layers), decoder(layers, seed=1)
    assert torch.equal(before, torch.get_rng_state())
    assert torch.equal(first.shared[0].weight, again.shared[0].weight)
    assert not torch.equal(first.shared[0].weight, other.shared[0].weight)
