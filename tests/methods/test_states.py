"""States of the models of all methods."""

import pytest
import torch
from support.gaussians import gaussians
from support.model_gradients import drawn
from support.moving_models import MODELS
from support.moving_splats import at, seeded
from support.states import assert_same_bits

from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.table import SplatTable

ALL = {"static": gaussians, **MODELS}


@pytest.mark.parametrize("name", ALL)
def test_the_same_seed_gives_the_same_model(name):
    assert_same_bits(ALL[name]().state_dict(), ALL[name]().state_dict())


@pytest.mark.parametrize("name", ALL)
def test_a_restored_model_is_the_same_whatever_its_rows_were(name):
    model, other = ALL[name](), ALL[name]()
    table = SplatTable(model, Optimizer(model, Operators(), OptimizerSettings()))
    table.append(model.clone_rows(torch.tensor([1, 2]), seeded()))
    with torch.no_grad():
        for group in model.parameter_groups():
            for parameter in group.parameters:
                parameter.mul_(1.5)
    other.load_state_dict(model.state_dict())
    assert other.num_rows == model.num_rows
    assert_same_bits(other.state_dict(), model.state_dict())
    assert_same_bits(drawn(other, at(0.3)), drawn(model, at(0.3)))
