"""No density control."""

import torch
from support.gaussians import gaussians, table_of
from support.refining import StrategyRun
from support.states import assert_same_bits

from gsfw.core.capabilities import Needs
from gsfw.strategies.none import NoneConfig


def test_it_changes_nothing_and_needs_nothing():
    model = gaussians(4)
    before = {name: value.clone() for name, value in model.state_dict().items()}
    strategy = StrategyRun(NoneConfig())
    _, table = table_of(model)
    assert all(strategy.edit(s, table, model, torch.Generator()) == {} for s in range(50))
    assert_same_bits(dict(model.state_dict()), before)
    assert strategy.statistics(0) == frozenset()
    assert strategy.state_dict() == {}
    assert NoneConfig().needs() == Needs()
