"""The decoder: one hidden layer for each quantity, and outputs that begin at zero."""

import torch
from torch.nn.functional import linear, relu

from gsfw.core.operators import Operators
from gsfw.methods.gaussians4d.decoder import Decoder

OUTPUTS = {"means": 3, "quats": 4}


def decoder(depth: int, seed: int = 0) -> Decoder:
    return Decoder(6, 5, depth, OUTPUTS, Operators(), torch.Generator().manual_seed(seed))


def test_outputs_begin_at_zero_whatever_is_given():
    for depth in (0, 1, 3):
        found = decoder(depth)(1e6 * torch.randn(9, 6))
        assert {name: value.shape for name, value in found.items()} == {
            "means": (9, 3), "quats": (9, 4),
        }  # fmt: skip
        assert all(not value.any() for value in found.values())


def test_each_quantity_has_a_hidden_layer_of_its_own():
    model = decoder(2)
    for output in model.outputs.values():
        torch.nn.init.normal_(output.weight)
    given = torch.randn(4, 6)
    first, second = model.shared
    features = second(relu(first(given)))
    assert model.hidden is not None
    for index, (name, output) in enumerate(model.outputs.items()):
        rows = slice(5 * index, 5 * index + 5)
        hidden = relu(linear(relu(features), model.hidden.weight[rows], model.hidden.bias[rows]))
        torch.testing.assert_close(model(given)[name], output(hidden))


def test_the_same_seed_draws_the_same_layers_and_leaves_torch_s_generator_alone():
    before = torch.get_rng_state()
    first, again, other = decoder(1), decoder(1), decoder(1, seed=1)
    assert torch.equal(before, torch.get_rng_state())
    assert torch.equal(first.shared[0].weight, again.shared[0].weight)
    assert not torch.equal(first.shared[0].weight, other.shared[0].weight)
