"""How strongly a step pulls at the temporal centres of the models that have them."""

import pytest
import torch
from support.moving_splats import spacetime
from support.scenes import random_splats

from gsfw.core.column import Column, Layout
from gsfw.core.learning_rate import LearningRate
from gsfw.core.operators import Operators
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.methods.moving.center_gradient import center_gradients
from gsfw.methods.rotor4d.config import SlicedGaussiansOptim
from gsfw.methods.rotor4d.model import SlicedGaussians
from gsfw.methods.rotor4d.regularization import Regularization
from gsfw.methods.rotor4d.rotor import Rotor

RATE = LearningRate(1e-3)


def test_dense_centres_have_the_size_of_their_gradient():
    centers = Column(torch.zeros(3), RATE)
    assert center_gradients(centers) is None
    centers.values.grad = torch.tensor([-2.0, 0.0, 3.0])
    assert center_gradients(centers).tolist() == [2.0, 0.0, 3.0]


@pytest.mark.parametrize(
    ("lengths", "expected"),
    [
        ([0, 1, 0, 1, 0], [0.0, 2.0, 0.0, 3.0, 0.0]),
        ([1, 1], [2.0, 3.0]),
        ([0, 0, 0], [0.0, 0.0, 0.0]),
        ([], []),
    ],
)
def test_rows_without_a_centre_have_no_gradient(lengths, expected):
    offsets = torch.tensor([0, *lengths]).cumsum(0)
    centers = Column(torch.zeros(sum(lengths)), RATE, Layout.RAGGED, offsets)
    centers.values.grad = torch.tensor([-2.0, 3.0])[: sum(lengths)]
    assert center_gradients(centers).tolist() == expected


def test_nothing_is_read_where_a_gpu_would_have_to_be_waited_for():
    centers = Column(torch.zeros(1), RATE, Layout.RAGGED, torch.tensor([0, 1, 1])).to("meta")
    centers.values.grad = torch.zeros(1, device="meta")
    assert center_gradients(centers).is_meta


def sliced(n: int = 12) -> SlicedGaussians:
    rates = SlicedGaussiansOptim().learning_rates(1.0)
    canonical = StaticGaussians(from_splats(random_splats(n, degree=1), 1), rates)
    regularization = Regularization(0.0, 0.0, 100)
    centers = torch.linspace(0, 1, n)
    return SlicedGaussians(
        canonical, centers, rates, Rotor(), Operators(),
        duration=0.3, min_duration=0.05, regularization=regularization,
    )  # fmt: skip


@pytest.mark.parametrize("make", [sliced, lambda: spacetime(12)], ids=["4d-rotor", "spacetime"])
def test_models_say_how_the_loss_changes_with_each_centre_in_sequences(make):
    model = make()
    assert model.time_gradients() is None
    centers, time = model.columns()["time_centers"].values, torch.tensor(0.4)
    weights = torch.rand(model.num_rows, generator=torch.Generator().manual_seed(0)).to(centers)

    def loss():
        splats = model.splats(time.to(centers))
        shown = weights if splats.rows is None else weights[splats.rows]
        return (shown * splats.opacities).sum()

    loss().backward()
    found = model.time_gradients()
    assert found.shape == (model.num_rows,)
    step = 1e-3
    for row in range(model.num_rows):
        ends = []
        for sign in (1.0, -1.0):
            with torch.no_grad():
                centers[row] += sign * step
                ends.append(float(loss()))
                centers[row] -= sign * step
        assert float(found[row]) == pytest.approx(abs(ends[0] - ends[1]) / (2 * step), abs=5e-3)


def test_motion_does_not_pull_at_the_centres_of_spacetime():
    model = spacetime(12)
    model.splats(torch.tensor(0.4, dtype=torch.float64)).means.sum().backward()
    found = model.time_gradients()
    assert found is None or not found.any()
