"""Tests of method my-part."""

import torch
from gsfw.api import Operators, Scene
from gsfw.testing import conformance

from my_part import method

test_conforms = conformance("method", "my-part")


def small_model() -> method.MyPartGaussians:
    """Two Gaussians at rest."""
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0]])
    scene = Scene("toy", points, points, torch.tensor([[0.0, 0, -4]]), 1.0, num_times=3)
    generator = torch.Generator().manual_seed(0)
    chosen = method.MyPartConfig(waves=2).build()
    model = chosen.build_model(scene, Operators(), generator, None)
    assert isinstance(model, method.MyPartGaussians)
    return model


def test_gaussians_start_at_rest():
    model = small_model()
    torch.testing.assert_close(model.splats(torch.tensor(0.7)).means, model.splats().means)


def test_a_path_is_a_sum_of_waves():
    model = small_model()
    with torch.no_grad():
        model.paths.values[0, 0] = torch.tensor([0.0, 2.0, 0.0])  # The sine of wave 1.
    moved = model.splats(torch.tensor(0.5)).means - model.splats().means
    torch.testing.assert_close(moved, torch.tensor([[0.0, 2.0, 0.0], [0.0, 0.0, 0.0]]))
