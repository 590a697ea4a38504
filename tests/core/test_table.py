"""The table: rows and moments stay together, whatever is done to them."""

import copy

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.mixed_model import MixedModel, row_values, with_optimizer

from gsfw.core.column import Rows


def everything(model, optimizer):
    """Values and moments of every row of every column."""
    found = {}
    for name, column in model.columns().items():
        found[name] = row_values(column)
        if column.trained:
            (moments,) = optimizer.moments(name)
            found[name, "first"] = row_values(column, moments.first)
            found[name, "second"] = row_values(column, moments.second)
            found[name, "count"] = [float(moments.count)]
    return found


def assert_rows_came_from(after, before, rows, fresh=()):
    """Row i is what row ``rows[i]`` was; those at positions in ``fresh`` have moments of zero."""
    for key, values in after.items():
        if isinstance(key, tuple) and key[1] == "count":
            assert values == before[key]
            continue
        for position, source in enumerate(rows):
            expected = before[key][source]
            if isinstance(key, tuple) and position in fresh:
                expected = [0.0] * len(expected)
            assert values[position] == expected, (key, position)
        assert len(values) == len(rows)


@settings(max_examples=15)
@given(st.data())
def test_kept_and_appended_rows_keep_values_and_moments_aligned(data):
    n = data.draw(st.integers(1, 12))
    kept = data.draw(st.lists(st.integers(0, n - 1), max_size=12))
    cloned = data.draw(st.lists(st.integers(0, n - 1), max_size=6))
    model = MixedModel(n)
    optimizer, table = with_optimizer(model)
    before = everything(model, optimizer)
    children = model.clone_rows(torch.tensor(cloned, dtype=torch.int64))
    table.edit(torch.tensor(kept, dtype=torch.int64), children)
    assert len(table) == len(kept) + len(cloned)
    fresh = range(len(kept), len(table))
    assert_rows_came_from(everything(model, optimizer), before, [*kept, *cloned], fresh)


@settings(max_examples=15)
@given(st.lists(st.booleans(), min_size=1, max_size=12))
def test_a_mask_keeps_rows_in_their_order(mask):
    model = MixedModel(len(mask))
    optimizer, table = with_optimizer(model)
    before = everything(model, optimizer)
    table.keep(torch.tensor(mask))
    rows = [i for i, keep in enumerate(mask) if keep]
    assert_rows_came_from(everything(model, optimizer), before, rows)


@settings(max_examples=15)
@given(st.integers(8, 20), st.data())
def test_replaced_rows_begin_with_moments_of_zero(n, data):
    # Rows that are seven apart have ragged values of the same length.
    targets = data.draw(st.lists(st.integers(7, n - 1), max_size=5, unique=True))
    model = MixedModel(n)
    optimizer, table = with_optimizer(model)
    before = everything(model, optimizer)
    sources = [target - 7 for target in targets]
    children = model.clone_rows(torch.tensor(sources, dtype=torch.int64))
    table.replace(torch.tensor(targets, dtype=torch.int64), children)
    rows = list(range(n))
    for target, source in zip(targets, sources, strict=True):
        rows[target] = source
    assert_rows_came_from(everything(model, optimizer), before, rows, targets)


def broken_children(model, how):
    children = dict(model.clone_rows(torch.tensor([8, 9])))
    if how == "missing column":
        del children["banded"]
    elif how == "other number of rows":
        children["banded"] = Rows(children["banded"].values[:1])
    elif how == "other shape":
        children["banded"] = Rows(children["banded"].values[:, :1])
    elif how == "ragged lengths that do not add up":
        children["ragged"] = Rows(children["ragged"].values[1:], children["ragged"].lengths)
    return children


MESSAGES = {
    "missing column": "expected the columns",
    "other number of rows": "new rows: expected 2 in every column, found",
    "other shape": "do not fit a dense column",
    "ragged lengths that do not add up": "do not fit a ragged column",
}


@pytest.mark.parametrize("how", MESSAGES)
@pytest.mark.parametrize("verb", ["append", "replace"])
def test_an_edit_that_fails_changes_nothing(how, verb):
    model = MixedModel(10)
    optimizer, table = with_optimizer(model)
    before = copy.deepcopy(everything(model, optimizer))
    children = broken_children(model, how)
    arguments = (children,) if verb == "append" else (torch.tensor([1, 2]), children)
    with pytest.raises(ValueError, match=MESSAGES[how]):
        getattr(table, verb)(*arguments)
    assert everything(model, optimizer) == before


def test_replacing_more_rows_than_are_given_changes_nothing():
    model = MixedModel(10)
    optimizer, table = with_optimizer(model)
    before = copy.deepcopy(everything(model, optimizer))
    with pytest.raises(ValueError, match="new rows: expected 3 in every column"):
        table.replace(torch.tensor([1, 2, 3]), model.clone_rows(torch.tensor([8, 9])))
    with pytest.raises(ValueError, match="ragged rows keep their number of values"):
        table.replace(torch.tensor([0]), model.clone_rows(torch.tensor([1])))
    with pytest.raises(ValueError, match="a mask of 9 rows for 10"):
        table.keep(torch.ones(9, dtype=torch.bool))
    assert everything(model, optimizer) == before


def test_resetting_a_column_zeroes_its_moments_and_not_its_count():
    model = MixedModel(4)
    optimizer, table = with_optimizer(model)
    table.reset_columns(["dense"])
    (dense,), (stacked,) = optimizer.moments("dense"), optimizer.moments("stacked")
    assert not dense.first.any()
    assert not dense.second.any()
    assert float(dense.count) == 5
    assert stacked.first.all()


def test_an_edited_model_goes_on_training():
    model = MixedModel(6)
    optimizer, table = with_optimizer(model)
    table.edit(torch.tensor([5, 0]), model.clone_rows(torch.tensor([1])))
    before = {name: column.values.detach().clone() for name, column in model.columns().items()}
    trained = {name: column for name, column in model.columns().items() if column.trained}
    sum(column.values.square().sum() for column in trained.values()).backward()
    optimizer.step(0, torch.tensor(True))
    for name, column in trained.items():
        assert not torch.equal(column.values, before[name])
    assert torch.equal(model.labels.values, before["labels"])
    assert table.learning_rate("dense", 0) == 0.1


@settings(max_examples=15)
@given(st.data())
def test_a_ragged_row_keeps_what_it_had_when_its_length_changes(data):
    n = data.draw(st.integers(1, 9))
    lengths = data.draw(st.lists(st.integers(0, 9), min_size=n, max_size=n))
    model = MixedModel(n)
    optimizer, table = with_optimizer(model)
    before = everything(model, optimizer)
    table.resize("ragged", torch.tensor(lengths))
    after = everything(model, optimizer)
    for key, rows in after.items():
        if key in ("ragged", ("ragged", "first"), ("ragged", "second")):
            for old, new, length in zip(before[key], rows, lengths, strict=True):
                assert len(new) == 2 * length  # Each value is a pair.
                kept = min(len(old), len(new))
                assert new[:kept] == old[:kept]
                assert not any(new[kept:])
        else:
            assert rows == before[key]


def test_only_ragged_rows_have_lengths_to_change():
    table = with_optimizer(MixedModel(3))[1]
    with pytest.raises(ValueError, match="found 3 for a dense one"):
        table.resize("dense", torch.tensor([1, 1, 1]))
    with pytest.raises(ValueError, match="expected lengths for the 3 rows"):
        table.resize("ragged", torch.tensor([1, 1]))
