"""The optimizer: Adam as torch has it, and what it leaves alone."""

import copy

import pytest
import torch
from support.mixed_model import MixedModel, with_optimizer
from support.states import assert_same_bits

from gsfw.core.learning_rate import COOLED, Cooldown
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators

YES, NO = torch.tensor(True), torch.tensor(False)


def loss(model, step):
    """Gradients that differ from step to step and row to row."""
    columns = [column for column in model.columns().values() if column.trained]
    total = sum(((column.values - 1 - 0.1 * step) ** 3).sum() for column in columns)
    return total + model.network(torch.ones(1, 2, dtype=torch.float64)).square().sum()


def fresh(n=6, settings=None, **options):
    model = MixedModel(n, **options)
    return model, Optimizer(model, Operators(), settings or OptimizerSettings())


def snapshot(model, optimizer):
    return copy.deepcopy((dict(model.state_dict()), optimizer.state_dict()))


def test_it_is_adam_as_torch_has_it():
    model, optimizer = fresh()
    twin = copy.deepcopy(model)
    columns = [column.values for column in twin.columns().values() if column.trained]
    reference = torch.optim.AdamW(
        [
            {"params": columns, "lr": 0.1, "weight_decay": 0.0},
            {"params": list(twin.network.parameters()), "lr": 0.01, "weight_decay": 0.1},
        ],
        eps=1e-15,
    )
    for step in range(20):
        loss(model, step).backward()
        optimizer.step(step, YES)
        optimizer.zero_gradients()
        reference.zero_grad()
        loss(twin, step).backward()
        reference.step()
    for name, value in model.state_dict().items():
        torch.testing.assert_close(value, twin.state_dict()[name], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("steps_before", [0, 3])
@pytest.mark.parametrize("sparse", [False, True])
def test_a_step_that_is_not_finite_changes_nothing(dtype, steps_before, sparse):
    model, optimizer = fresh(settings=OptimizerSettings(sparse=sparse))
    model, visible = model.to(dtype), torch.ones(6, dtype=torch.bool)
    optimizer = Optimizer(model, Operators(), OptimizerSettings(sparse=sparse))
    for step in range(steps_before):
        sum(column.values.square().sum() for column in trained(model)).backward()
        optimizer.step(step, YES, visible)
        optimizer.zero_gradients()
    before = snapshot(model, optimizer)
    for column in trained(model):
        column.values.grad = torch.full_like(column.values, torch.nan)
        column.values.grad[0] = torch.inf
    for parameter in model.network.parameters():
        parameter.grad = torch.full_like(parameter, torch.nan)
    optimizer.step(steps_before, NO, visible)
    assert_same_bits(snapshot(model, optimizer), before)


def trained(model):
    return [column for column in model.columns().values() if column.trained]


def test_a_huge_gradient_leaves_finite_moments():
    model = MixedModel(3, dtype=torch.float32)
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    model.dense.values.grad = torch.full_like(model.dense.values, 3e38)
    optimizer.step(0, YES)
    (moments,) = optimizer.moments("dense")
    assert bool(moments.second.isfinite().all())
    assert bool(model.dense.values.isfinite().all())


def test_sparse_steps_leave_unseen_rows_and_their_moments_alone():
    model, optimizer = fresh(settings=OptimizerSettings(sparse=True))
    plain, everywhere = fresh(settings=OptimizerSettings(sparse=False))
    seen = torch.tensor([True, False, True, False, False, True])
    for step in range(3):
        visible = seen if step else ~seen
        for one, other in ((model, optimizer), (plain, everywhere)):
            loss(one, 0).backward()
            other.step(step, YES, visible)
            other.zero_gradients()
        if step == 0:
            before = snapshot(model, optimizer)
    (moments,) = optimizer.moments("dense")
    saved = before[1]["moments"]["dense"][0]
    assert torch.equal(model.dense.values[~seen], before[0]["dense.values"][~seen])
    assert torch.equal(moments.first[~seen], saved["first"][~seen])
    assert torch.equal(moments.second[~seen], saved["second"][~seen])
    assert not torch.equal(model.dense.values[seen], before[0]["dense.values"][seen])
    # Stacked and ragged columns, and parameter groups, take plain steps.
    assert torch.equal(model.stacked.values, plain.stacked.values)
    assert torch.equal(model.ragged.values, plain.ragged.values)
    assert torch.equal(model.network.weight, plain.network.weight)


def test_sparse_steps_that_see_every_row_are_plain_steps():
    model, optimizer = fresh(settings=OptimizerSettings(sparse=True))
    plain, everywhere = fresh()
    for step in range(3):
        for one, other in ((model, optimizer), (plain, everywhere)):
            loss(one, step).backward()
            other.step(step, YES, torch.ones(6, dtype=torch.bool))
            other.zero_gradients()
    assert_same_bits(snapshot(model, optimizer), snapshot(plain, everywhere))


@pytest.mark.parametrize("sparse", [False, True])
def test_leaving_out_inactive_bands_equals_plain_adam(sparse):
    settings = OptimizerSettings(sparse=sparse)
    model, optimizer = fresh(bands=4, settings=settings)
    plain, everywhere = fresh(bands=4, settings=settings)
    visible = torch.ones(6, dtype=torch.bool)
    for step, bands in enumerate([0, 0, 1, 1, 3, 3, 4]):
        model.active = bands
        for one in (model, plain):
            for column in trained(one):
                column.values.grad = torch.ones_like(column.values)
            one.banded.values.grad[:, bands:] = 0
        if bands == 0:  # A model that does not draw its bands gives them no gradient at all.
            model.banded.values.grad = None
        optimizer.step(step, YES, visible)
        everywhere.step(step, YES, visible)
    assert_same_bits(snapshot(model, optimizer), snapshot(plain, everywhere))


def test_frozen_columns_stay_until_they_are_unfrozen():
    model, optimizer = fresh()
    optimizer.freeze(["dense", "network"])
    before = copy.deepcopy(dict(model.state_dict()))
    loss(model, 0).backward()
    optimizer.step(0, YES)
    after = model.state_dict()
    assert torch.equal(after["dense.values"], before["dense.values"])
    assert torch.equal(after["network.weight"], before["network.weight"])
    assert not torch.equal(after["stacked.values"], before["stacked.values"])
    assert optimizer.learning_rates(0)["dense"] == 0.0


def test_all_rates_fall_in_the_cooldown():
    _, usual = fresh()
    _, cooling = fresh(settings=OptimizerSettings(cooldown=Cooldown(0, 10)))
    for name, rate in usual.learning_rates(10).items():
        assert cooling.learning_rates(10)[name] == pytest.approx(COOLED * rate)
    assert cooling.learning_rates(0) == usual.learning_rates(0)


def test_a_reset_column_starts_like_a_new_one():
    model = MixedModel(4)
    optimizer, _ = with_optimizer(model)
    optimizer.reset(["dense"])
    (moments,) = optimizer.moments("dense")
    assert not moments.first.any()
    assert float(moments.count) == 0


def test_a_restored_optimizer_continues_with_the_same_bits():
    model, optimizer = fresh()
    for step in range(4):
        loss(model, step).backward()
        optimizer.step(step, YES)
        optimizer.zero_gradients()
    optimizer.freeze(["labels", "stacked"])
    state = snapshot(model, optimizer)
    other_model, other = fresh(n=3)
    other_model.load_state_dict(state[0])
    other.load_state_dict(state[1])
    for one, its in ((model, optimizer), (other_model, other)):
        loss(one, 4).backward()
        its.step(4, YES)
    assert_same_bits(snapshot(model, optimizer), snapshot(other_model, other))
    # What was restored is a copy.
    assert not torch.equal(state[0]["dense.values"], other_model.dense.values)
